"""How the controller's tracking frame stands to the arm, and which button plays which part."""

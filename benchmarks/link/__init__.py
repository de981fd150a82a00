"""What a session on two computers does to control, and what an outage does to the arm."""

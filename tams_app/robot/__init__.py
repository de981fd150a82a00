"""The robot's side of a session: everything that can stop the arm."""

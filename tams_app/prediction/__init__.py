"""The present, predicted from what is late: where the arm is now, and what a camera on it sees."""

"""What people look at and type into: live line, window, doctor, dialogue."""

__all__ = ["app", "doctor", "report", "window"]

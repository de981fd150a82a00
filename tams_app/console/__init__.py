"""What people look at and type into: live line, windows, doctor, dialogue."""

__all__ = ["app", "doctor", "report", "windows"]

"""Sessions as compositions of the two sides, and what they leave behind."""

__all__ = ["operate", "robot", "run", "virtual"]

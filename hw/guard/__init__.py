"""The process that stops the arm when the control loop falls silent."""

__all__ = ["link", "process"]

"""Teleoperation, pure: a sample of the hand in, a command for the arm out, once per control tick.

`loop.Teleop` is the whole; nothing here knows a device, a thread, a file or the time.
"""

__all__ = ["loop", "reasons", "records", "safety"]

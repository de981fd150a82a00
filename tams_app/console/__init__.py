"""The commands and their output: sessions on the terminal, doctor, reports, speed, replay."""

__all__ = ["app", "doctor", "report"]

"""What the commands do and print: sessions on the terminal, doctor, reports, speed, replay."""

__all__ = ["app", "doctor", "report"]

"""The state of a replay: position, speed and pause; pure."""

from __future__ import annotations

from tams_app.units import NS_PER_S

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
STEP_NS = 5 * NS_PER_S


class Playback:
    """A position between the start and the end of a log [ns of the session's clock]."""

    def __init__(self, start_ns: int, end_ns: int, speed: float) -> None:
        """`speed`: times the real one; any above 0."""
        self.start_ns, self.end_ns = start_ns, max(start_ns, end_ns)
        self.position_ns = start_ns
        self.speed = speed
        self.paused = False
        self.jumps = 0  # how often it went elsewhere than on
        self._now_ns = 0

    @property
    def at_end(self) -> bool:
        return self.position_ns >= self.end_ns

    def begin(self, now_ns: int) -> None:
        """Go on from `now_ns`: what has passed until then does not count."""
        self._now_ns = now_ns

    def step(self, now_ns: int) -> int:
        """The position at `now_ns`; at the end it stays there."""
        passed_ns, self._now_ns = now_ns - self._now_ns, now_ns
        if not self.paused:
            self.position_ns = min(self.end_ns, self.position_ns + round(passed_ns * self.speed))
        return self.position_ns

    def toggle(self) -> None:
        """Pause, or go on; from the end go on from the start."""
        if self.at_end:
            self.seek(self.start_ns)
            self.paused = False
        else:
            self.paused = not self.paused

    def pause(self) -> None:
        """Stay here."""
        self.paused = True

    def seek(self, position_ns: int) -> None:
        """Go there, but no further than there is a log."""
        self.position_ns = min(self.end_ns, max(self.start_ns, position_ns))
        self.jumps += 1

    def move(self, by_ns: int) -> None:
        """Forward or back, as `seek`."""
        self.seek(self.position_ns + by_ns)

    def faster(self, steps: int) -> None:
        """So many steps faster (slower, where negative) among `SPEEDS`."""
        nearest = min(range(len(SPEEDS)), key=lambda at: abs(SPEEDS[at] - self.speed))
        self.speed = SPEEDS[min(len(SPEEDS) - 1, max(0, nearest + steps))]

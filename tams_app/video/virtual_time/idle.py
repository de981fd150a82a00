"""When the threads behind the jitter buffers must be awaited, and when their work cannot be seen.

A packet that comes in order while no jitter buffer waits for anything is stored and handed on,
whatever the time. Only the end of a frame, a gap and what follows a gap have an effect that
depends on when it happens, or that anybody looks at. Waiting for these alone is exact, and halves
the cost.
"""

from __future__ import annotations

from tams_app.video.virtual_time.stepped_clock import SteppedClock
from tams_app.video.virtual_time.wait_idle import Quiescence


class Rest:
    """Awaits quiescence where it matters."""

    def __init__(self, quiescence: Quiescence, clock: SteppedClock) -> None:
        self._quiescence = quiescence
        self._clock = clock
        self._owed = False  # a packet went in and was not awaited
        self._due = False

    def disturb(self, in_order: bool, ends_frame: bool) -> None:
        """A packet is about to enter a jitter buffer."""
        delicate = not in_order or self._clock.next_ns() is not None
        if delicate and self._owed:
            self._quiescence.wait()
        self._owed = True
        self._due |= delicate or ends_frame

    def wait_if_due(self) -> bool:
        """After an event: wait if it had an effect; whether it had."""
        if self._due:
            self.wait()
            return True
        return False

    def wait(self) -> None:
        """Wait until all that went in has had its effect."""
        self._quiescence.wait()
        self._owed = self._due = False

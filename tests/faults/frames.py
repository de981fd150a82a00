"""What the operator sees, as far as the control loop asks: how old the frame of a view is."""

from __future__ import annotations

from typing import Protocol

from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS

PICTURE_DELAY_NS = 60 * NS_PER_MS


class Sight(Protocol):
    """What the operator sees: the part of `Uplink` that the control loop asks."""

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the newest frame of `view` that counts."""

    def is_damaged(self, view: str) -> bool:
        """Whether a newer frame is shown, which is not whole."""


class Frames:
    """Each view some time old, or frozen."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._captured_ns: dict[str, int] = {}

    def freeze(self, *views: str) -> None:
        """From now on the frame of these views stays what it is."""
        shown_ns = self._clock.now_ns() - PICTURE_DELAY_NS
        self._captured_ns.update(dict.fromkeys(views, shown_ns))

    def thaw(self) -> None:
        """All views move again."""
        self._captured_ns.clear()

    def age_ns(self, view: str, now_ns: int) -> int | None:
        return now_ns - self._captured_ns.get(view, now_ns - PICTURE_DELAY_NS)

    def is_damaged(self, view: str) -> bool:
        return False

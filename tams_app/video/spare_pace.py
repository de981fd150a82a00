"""How fast work may go that must only take what a machine has to spare."""

from __future__ import annotations

from collections.abc import Callable

from tams_app.runtime.clock import NS_PER_MS

LEAST_SHARE = 0.04  # of one core: a few frames a second, so that there is always a figure
LARGEST_SHARE = 0.5
SCARCE_IDLE, AMPLE_IDLE = 0.05, 0.10  # of all cores
_LOOK_NS = 500 * NS_PER_MS
_GROWTH, _BACK_OFF = 0.05, 0.5


class SparePace:
    """The share of a core that may be used: halved while no core is idle, else grown slowly.

    `idle_fraction` tells how much of all cores nobody has used since its last call (0 to 1).
    """

    def __init__(self, idle_fraction: Callable[[], float], now_ns: int) -> None:
        self.share = LEAST_SHARE
        self._idle_fraction = idle_fraction
        self._looked_ns = now_ns

    def rest_ns(self, worked_ns: int, now_ns: int) -> int:
        """How long to rest after `worked_ns` of work that ends now."""
        if now_ns - self._looked_ns >= _LOOK_NS:
            self._looked_ns = now_ns
            self._adapt(self._idle_fraction())
        return round(worked_ns * (1 / self.share - 1))

    def _adapt(self, idle: float) -> None:
        if idle < SCARCE_IDLE:
            self.share = max(LEAST_SHARE, self.share * _BACK_OFF)
        elif idle > AMPLE_IDLE:
            self.share = min(LARGEST_SHARE, self.share + _GROWTH)

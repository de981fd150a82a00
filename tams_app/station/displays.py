"""Liveness of the displays that show video to the operator: on a dead one old pictures stay."""

from __future__ import annotations

from collections.abc import Callable


class Displays:
    """Window and headset of a session; from any thread."""

    def __init__(self) -> None:
        self._received_ns: tuple[Callable[[], int], ...] = ()

    def add(self, heard_ns: Callable[[], int]) -> None:
        """One more, and when it reported last that it works, or was opened."""
        self._received_ns = (*self._received_ns, heard_ns)

    def heard_ns(self) -> int | None:
        """The last report [ns] of the display that is silent longest; None without any."""
        return min((heard_ns() for heard_ns in self._received_ns), default=None)

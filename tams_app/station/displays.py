"""When what shows the video to the operator worked last: else old pictures stay on it."""

from __future__ import annotations

from collections.abc import Callable


class Displays:
    """Window and headset of a session; from any thread."""

    def __init__(self) -> None:
        self._heard_ns: tuple[Callable[[], int], ...] = ()

    def add(self, heard_ns: Callable[[], int]) -> None:
        """One more, and when it told last that it works, or was opened."""
        self._heard_ns = (*self._heard_ns, heard_ns)

    def heard_ns(self) -> int | None:
        """When the one that is silent longest told last that it works; None without any."""
        return min((heard_ns() for heard_ns in self._heard_ns), default=None)

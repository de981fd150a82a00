"""What the displays show to the operator: on a dead one old pictures stay."""

from __future__ import annotations

from collections.abc import Callable


class Displays:
    """Window and headset of a session; from any thread."""

    def __init__(self) -> None:
        self._seen_ns: tuple[Callable[[str], int], ...] = ()

    def add(self, seen_ns: Callable[[str], int]) -> None:
        """One more, and when the frame of a view was decoded that it shows; or when it opened."""
        self._seen_ns = (*self._seen_ns, seen_ns)

    def __bool__(self) -> bool:
        return bool(self._seen_ns)

    def seen_ns(self, view: str) -> int | None:
        """When the newest frame of `view` that all show was decoded [ns]; None without any."""
        return min((seen_ns(view) for seen_ns in self._seen_ns), default=None)

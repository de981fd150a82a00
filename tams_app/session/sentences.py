"""Sentences for the person at the console, until it has printed them."""

from __future__ import annotations

from collections import deque

_KEPT = 50  # of those not taken yet; older ones are dropped


class Sentences:
    """Noted by any thread, taken by the console."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque(maxlen=_KEPT)

    def note(self, text: str) -> None:
        """A sentence that the console should print."""
        self._waiting.append(text)

    def take(self) -> list[str]:
        """Sentences not printed yet, in their order."""
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

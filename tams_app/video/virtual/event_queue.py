"""A queue of actions in the order of time, and of posting where times are equal."""

from __future__ import annotations

import heapq
from collections.abc import Callable


class EventQueue:
    """A queue of actions, each done once at its time."""

    def __init__(self) -> None:
        self._posted = 0
        self._entries: list[tuple[int, int, Callable[[], None]]] = []

    @property
    def next_ns(self) -> int | None:
        """The time when the next action is due [ns]; None if there is none."""
        return self._entries[0][0] if self._entries else None

    def post(self, due_ns: int, action: Callable[[], None]) -> None:
        self._posted += 1
        heapq.heappush(self._entries, (due_ns, self._posted, action))

    def do_next(self) -> None:
        heapq.heappop(self._entries)[2]()

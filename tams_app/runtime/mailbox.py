"""Exchange between threads: a mailbox of one, a bounded queue that counts its drops, sentences."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Generic, TypeVar

T = TypeVar("T")
_SENTENCES = 50  # of those not taken yet; older ones are dropped


class Mailbox(Generic[T]):
    """Holds the newest item only; putting never blocks, an unread item is overwritten."""

    def __init__(self) -> None:
        self._item: T | None = None

    def put(self, item: T) -> None:
        self._item = item

    def latest(self) -> T | None:
        """The newest item, read or not; None before the first."""
        return self._item


class BoundedQueue(Generic[T]):
    """A queue whose `put` never blocks: when full, the new item is dropped and counted."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._items: deque[T] = deque()
        self._condition = threading.Condition()
        self.dropped = 0

    def put(self, item: T) -> bool:
        """Queue `item`; False if there was no room."""
        with self._condition:
            if len(self._items) >= self._capacity:
                self.dropped += 1
                return False
            self._items.append(item)
            self._condition.notify()
            return True

    def put_all(self, items: Sequence[T]) -> None:
        """Queue `items` in order, as `put` each."""
        with self._condition:
            room = self._capacity - len(self._items)
            self._items.extend(items[:room])
            self.dropped += max(0, len(items) - room)
            self._condition.notify()

    def take_all(self, timeout_s: float = 0.0) -> list[T]:
        """All queued items in order, waiting up to `timeout_s` for the first."""
        with self._condition:
            if not self._items and timeout_s > 0:
                self._condition.wait_for(lambda: bool(self._items), timeout_s)
            items = list(self._items)
            self._items.clear()
            return items


class Sentences:
    """Sentences for a person, noted by any thread, until they are taken to be shown."""

    def __init__(self) -> None:
        self._waiting: deque[str] = deque(maxlen=_SENTENCES)
        self._others: tuple[Sentences, ...] = ()

    def note(self, text: str) -> None:
        """A sentence that should be shown."""
        self._waiting.append(text)
        for other in self._others:
            other.note(text)

    def forward_to(self, other: Sentences) -> None:
        """From now on `other` gets each of them as well."""
        self._others = (*self._others, other)

    def take(self) -> list[str]:
        """Sentences not shown yet, in their order."""
        taken = []
        with suppress(IndexError):  # also where another thread takes the last one
            while True:
                taken.append(self._waiting.popleft())
        return taken

"""How threads hand things over: a mailbox of one, or a bounded queue that counts its drops."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Holds the newest item only; putting never blocks, an unread item is overwritten."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._item: T | None = None
        self._version = 0

    def put(self, item: T) -> None:
        with self._condition:
            self._item = item
            self._version += 1
            self._condition.notify_all()

    def latest(self) -> T | None:
        """The newest item, read or not; None before the first."""
        with self._condition:
            return self._item

    def versioned(self) -> tuple[int, T | None]:
        """The number of items put so far, and the newest of them."""
        with self._condition:
            return self._version, self._item

    def wait_newer(self, version: int, timeout_s: float) -> tuple[int, T | None]:
        """Wait until more than `version` items were put or the time is over; see `versioned`."""
        with self._condition:
            self._condition.wait_for(lambda: self._version > version, timeout_s)
            return self._version, self._item


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

    def take_all(self, timeout_s: float = 0.0) -> list[T]:
        """All queued items in order, waiting up to `timeout_s` for the first."""
        with self._condition:
            if not self._items and timeout_s > 0:
                self._condition.wait_for(lambda: bool(self._items), timeout_s)
            items = list(self._items)
            self._items.clear()
            return items

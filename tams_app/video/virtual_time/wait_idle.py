"""Waiting until every other thread of this process is asleep, so that one event has had its effect.

GStreamer hands packets from thread to thread, and nothing it offers tells when the last of them
has nothing more to do. The kernel knows: a thread that sleeps in two looks, and was not once put
on a core in between, had nothing to do at the moment between them. A thread that waits for the
GIL cannot pass for idle: each read below releases the GIL, which wakes it. Linux only.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

from tams_app.errors import TamsError

_TASKS = "/proc/self/task"
_ASLEEP = ord("S")
PATIENCE_S = 20.0  # of the wall: no event of ours takes a tenth of it, even on a busy machine


class Quiescence:
    """Used by one thread; every other thread of the process must be idle between events."""

    def __init__(
        self, patience_s: float = PATIENCE_S, wall_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._patience_s = patience_s
        self._wall_s = wall_s
        self._files: dict[str, tuple[int, int]] = {}  # thread -> its stat and schedstat

    def wait(self) -> None:
        """Return when all others sleep; TamsError if they do not within the patience."""
        deadline_s = self._wall_s() + self._patience_s
        while not self._at_rest():
            if self._wall_s() > deadline_s:
                raise TamsError(
                    f"the process did not come to rest within {self._patience_s:g} s: "
                    "virtual time needs a process in which nothing else runs"
                )
            os.sched_yield()

    def close(self) -> None:
        """Close the files it looks into; may be called twice."""
        for pair in self._files.values():
            for file in pair:
                os.close(file)
        self._files.clear()

    def _at_rest(self) -> bool:
        try:
            self._open_new()
            if not self._all_asleep():
                return False
            known, counts = len(self._files), self._counts()
            if not (self._all_asleep() and self._all_asleep() and self._counts() == counts):
                return False
            self._open_new()
            return len(self._files) == known
        except ProcessLookupError:  # a thread has ended: look afresh
            self.close()
            return False

    def _open_new(self) -> None:
        own = str(threading.get_native_id())
        for thread in os.listdir(_TASKS):
            if thread == own or thread in self._files:
                continue
            try:
                stat = os.open(f"{_TASKS}/{thread}/stat", os.O_RDONLY)
            except FileNotFoundError:  # it ended meanwhile
                continue
            try:
                schedule = os.open(f"{_TASKS}/{thread}/schedstat", os.O_RDONLY)
            except FileNotFoundError:
                os.close(stat)
                continue
            self._files[thread] = (stat, schedule)

    def _all_asleep(self) -> bool:
        for stat, _ in self._files.values():
            text = os.pread(stat, 256, 0)
            if text[text.rindex(b")") + 2] != _ASLEEP:
                return False
        return True

    def _counts(self) -> list[bytes]:
        """Time on the core, time waiting for it, times put on it, of every thread."""
        return [os.pread(schedule, 64, 0) for _, schedule in self._files.values()]

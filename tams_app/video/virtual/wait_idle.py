"""Waiting until all other threads of this process are idle, so that an event has had its effect.

GStreamer hands packets from thread to thread, and nothing it offers shows when the last of them
has nothing more to do. The kernel knows: a thread that sleeps in two samples, and was not scheduled
in between, had nothing to do at the moment between them. A thread that waits for the GIL cannot
pass for idle: each read below releases the GIL, which wakes it. Linux only.
"""

from __future__ import annotations

import os
import threading
import time

from tams_app.errors import TamsError
from tams_app.video.virtual.stepped_clock import SteppedClock

_TASKS = "/proc/self/task"
_OTHER_LINKS = 3  # of the directory of tasks: its own two, and the thread that waits
_ASLEEP = ord("S")
TIMEOUT_S = 20.0  # real time: no event of ours takes a tenth of it, even on a busy machine
# Between two looks while a thread works. A frame takes milliseconds to decode: to look all the time
# would take as long on another core.
_PAUSE_S = 0.0002


class IdleWaiter:
    """Waits until all other threads are idle; used by one thread."""

    def __init__(self, timeout_s: float = TIMEOUT_S) -> None:
        self._timeout_s = timeout_s
        self._files: dict[str, tuple[int, int]] = {}  # thread -> its stat and schedstat
        self._last_busy: int | None = None  # its stat

    def wait(self) -> None:
        """Return when all others sleep; TamsError if they do not within the timeout."""
        deadline_s = time.monotonic() + self._timeout_s
        while not self._all_idle():
            if time.monotonic() > deadline_s:
                raise TamsError(
                    f"the process did not become idle within {self._timeout_s:g} s: "
                    "virtual time needs a process in which nothing else runs"
                )
            time.sleep(_PAUSE_S)

    def close(self) -> None:
        """Close the files it looks into; may be called twice."""
        for pair in self._files.values():
            for file in pair:
                os.close(file)
        self._files.clear()
        self._last_busy = None

    def _all_idle(self) -> bool:
        try:
            if self._last_busy is not None and not _is_asleep(self._last_busy):
                return False
            if not self._knows_all():
                self._open_new()
            counts = self._counts()
            if not (self._all_asleep() and self._all_asleep() and self._counts() == counts):
                return False
            return self._knows_all()
        except ProcessLookupError:  # a thread has ended: start over
            self.close()
            return False

    def _knows_all(self) -> bool:
        """True if there is no new thread; one that has ended shows when its files are read."""
        return os.stat(_TASKS).st_nlink == len(self._files) + _OTHER_LINKS

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
            if not _is_asleep(stat):
                self._last_busy = stat
                return False
        return True

    def _counts(self) -> list[bytes]:
        """Time on the core, time waiting for it, times put on it, of every thread."""
        return [os.pread(schedule, 64, 0) for _, schedule in self._files.values()]


def _is_asleep(stat: int) -> bool:
    text = os.pread(stat, 256, 0)
    return text[text.rindex(b")") + 2] == _ASLEEP


class IdleGate:
    """Waits for idle threads only where it matters.

    A packet that comes in order while no jitter buffer waits for anything is stored and handed on,
    whatever the time. Only the end of a frame, a gap and what follows a gap have an effect that
    depends on when it happens, or that is observed. Waiting for these alone is exact, and halves
    the cost.
    """

    def __init__(self, waiter: IdleWaiter, clock: SteppedClock) -> None:
        self._waiter = waiter
        self._clock = clock
        self._not_awaited = False  # a packet went in without a wait after it
        self._must_wait = False

    def packet_enters(self, in_order: bool, ends_frame: bool) -> None:
        sensitive = not in_order or self._clock.next_ns() is not None
        if sensitive and self._not_awaited:
            self._waiter.wait()
        self._not_awaited = True
        self._must_wait |= sensitive or ends_frame

    def wait_if_due(self) -> bool:
        """After an event: wait if it had an effect; whether it had."""
        if self._must_wait:
            self.wait()
            return True
        return False

    def wait(self) -> None:
        """Wait until all that went in has had its effect."""
        self._waiter.wait()
        self._not_awaited = self._must_wait = False

"""When this machine stood still, measured beside the tests by processes that do nothing else.

Two probes wake every 10 ms and note when they woke late. Neither can be held up by one thread of
what is tested, however long that one computes, sleeps or waits for a lock:

- one thread bound to each processor, above every other priority. It counts a gap only if the
  processor itself counted hardly any work in that time: it was taken away by the host. Where a
  real-time thread of the tests kept it busy, there is work, and no standstill;
- a process of ordinary priority that may run on any processor: none had time for it.

`python tests/standstills.py KIND` is the probe: it answers each line on its input with the
standstills since the last one, as JSON, and ends with its input.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

PERIOD_S = 0.01
LEAST_MS = 20.0  # a later wake-up than this is noted
_ABOVE_ALL = 99  # of SCHED_FIFO
_MOST_WORK = 0.5  # share of a gap for which a processor that stood still may have counted work
_ROUNDING_MS = 10.0  # a processor's work is counted in ticks
_KINDS = ("processors", "ordinary")
_MS = 1_000_000  # ns


class Standstill(NamedTuple):
    """From when until when [ns, time.monotonic_ns] what did not run."""

    what: str
    from_ns: int
    until_ns: int

    @property
    def ms(self) -> float:
        return (self.until_ns - self.from_ns) / _MS

    def within(self, window: Window) -> Standstill:
        """The part of it in `window`; one of no length or less if there is none."""
        from_ns, until_ns = max(self.from_ns, window[0]), min(self.until_ns, window[1])
        return Standstill(self.what, from_ns, until_ns)


Window = tuple[int, int]  # from when until when [ns, time.monotonic_ns]


class Standstills:
    """The probes, from `start` to `close`, and what they noted."""

    def __init__(self) -> None:
        self._probes: list[subprocess.Popen[str]] = []
        self._noted: list[Standstill] = []

    def start(self) -> None:
        """Start the probes once; without them, on a system that has no such thing, none stands."""
        if self._probes or not hasattr(os, "sched_setaffinity"):
            return
        self._probes = [
            subprocess.Popen(
                [sys.executable, "-I", __file__, kind],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for kind in _KINDS
        ]
        self._ask()  # until they run

    def longest(self, windows: Iterable[Window]) -> Standstill | None:
        """The longest one so far within any of the windows, cut to it."""
        self._ask()
        inside = [noted.within(window) for window in windows for noted in self._noted]
        longest = max(inside, key=lambda one: one.ms, default=None)
        return longest if longest is not None and longest.ms > 0.0 else None

    def close(self) -> None:
        """End the probes; may be called twice."""
        for probe in self._probes:
            assert probe.stdin is not None
            assert probe.stdout is not None
            probe.stdin.close()
            probe.wait(10)
            probe.stdout.close()
        self._probes = []

    def _ask(self) -> None:
        for probe in self._probes:
            assert probe.stdin is not None
            assert probe.stdout is not None
            probe.stdin.write("\n")
            probe.stdin.flush()
            self._noted += [Standstill(*each) for each in json.loads(probe.stdout.readline())]


def is_one(gap_ms: float, worked_ms: float) -> bool:
    """Whether so late a wake-up was a standstill of a processor that counted so much work."""
    return gap_ms > LEAST_MS and worked_ms < _MOST_WORK * gap_ms + _ROUNDING_MS


# --- in the probe's process ---------------------------------------------------------------------


@dataclass(slots=True)
class _Watch:
    """One thread that wakes again and again; `work_ms` tells what its processor did so far."""

    what: str
    work_ms: Callable[[], float] | None
    noted: list[Standstill]
    woke_ns: int = 0

    def run(self) -> None:
        work_ms = self.work_ms() if self.work_ms else 0.0
        due_ns = time.monotonic_ns()
        while True:
            due_ns += round(PERIOD_S * 1e9)
            time.sleep(max(0.0, (due_ns - time.monotonic_ns()) / 1e9))
            now_ns = time.monotonic_ns()
            gap = Standstill(self.what, due_ns, now_ns)
            worked_ms, work_ms = work_ms, self.work_ms() if self.work_ms else 0.0
            if is_one(gap.ms, work_ms - worked_ms):
                self.noted.append(gap)
            self.woke_ns = due_ns = now_ns


def _work_ms(processor: int) -> Callable[[], float]:
    """What that processor has done for processes and the kernel so far [ms]."""
    file = os.open("/proc/stat", os.O_RDONLY)
    tick_ms = 1000.0 / os.sysconf("SC_CLK_TCK")
    line = f"cpu{processor} "

    def read() -> float:
        text = os.pread(file, 1 << 16, 0).decode()
        at = text.index(line) + len(line)
        user, nice, system = text[at:].split(maxsplit=3)[:3]
        return (int(user) + int(nice) + int(system)) * tick_ms

    return read


def _bound(watch: _Watch, processor: int) -> None:
    os.sched_setaffinity(0, {processor})  # of this thread
    with contextlib.suppress(PermissionError):  # what holds it up then is work: it does not count
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_ABOVE_ALL))
    watch.run()


def main() -> None:
    """The argument: "processors" or "ordinary"."""
    noted: list[Standstill] = []
    if sys.argv[1] == "ordinary":
        watches = [_Watch("an ordinary process", None, noted)]
        runs: list[Callable[[], None]] = [watches[0].run]
    else:
        processors = sorted(os.sched_getaffinity(0))
        watches = [_Watch(f"processor {one}", _work_ms(one), noted) for one in processors]
        pairs = zip(watches, processors, strict=True)
        runs = [lambda pair=pair: _bound(*pair) for pair in pairs]  # type: ignore[misc]
    for run in runs:
        threading.Thread(target=run, daemon=True).start()
    for _ in sys.stdin:
        asked_ns = time.monotonic_ns()
        while any(watch.woke_ns < asked_ns for watch in watches):
            time.sleep(PERIOD_S)
        told, noted[:] = list(noted), []
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()

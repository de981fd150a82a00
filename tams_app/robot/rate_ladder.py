"""The ladder of frame rates: which one a machine that cannot keep up should hold.

Pure: time and observations go in, the rate comes out. `frame_rates.FrameRates` feeds it.

Down is quick, because every second on a rate too high costs the operator uneven frames and the
control loop late ticks: two observations of trouble in a row, and where frames were missed straight
to the rate that was reached in the better of them. Up is slow, because nothing but a trial shows
whether the machine holds more (what it has left goes to the comparison of frames, so no core is
ever idle), and a trial that fails costs up to three seconds of uneven frames. So it takes five calm
seconds, twice as many after each time that the same rate failed, up to a minute: trials then take
less than 5 % of the time. A rate that held for half a minute begins anew.
Between calm and trouble lies a band in which a rate is kept: one step up is up to 1.5 times the
work, and what only just holds should not be left for that.
"""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.runtime.machine_speed import rungs
from tams_app.units import NS_PER_S

TROUBLE_MISSED, CALM_MISSED = 0.10, 0.05  # of the frames due
TROUBLE_LATE, CALM_LATE = 0.02, 0.01  # of the control ticks
SUSTAINED = 2  # observations of trouble in a row
STARTING = 3  # observations that do not count: at the start much is done that is done once
SETTLING = 1  # ... and after a change: the one under way began before it
RAISE_AFTER_NS = 5 * NS_PER_S
LONGEST_WAIT_NS = 60 * NS_PER_S
HOLDS_AFTER_NS = 30 * NS_PER_S  # at one rate: earlier failures of it no longer count
_MEASURING = 1.05  # a rate reached is counted to within a frame or so


@dataclass(frozen=True, slots=True)
class Observation:
    """The figures of the time since the last one, about a second."""

    missed: float  # of the frames due, in the view that misses most
    late: float  # of the control ticks, skipped ones among them
    encoder_behind: bool = False  # frames waited for an encoder all the time

    @property
    def trouble(self) -> str:
        """The trouble in words, "" if there is none."""
        if self.missed > TROUBLE_MISSED:
            return f"{100 * self.missed:.0f} % of the frames were missed"
        if self.late > TROUBLE_LATE:
            return f"{100 * self.late:.0f} % of the control ticks were late"
        return "frames waited for an encoder" if self.encoder_behind else ""

    @property
    def calm(self) -> bool:
        """True if there may be room for more."""
        return self.missed <= CALM_MISSED and self.late <= CALM_LATE and not self.encoder_behind


class RateLadder:
    """Frames a second of all cameras together: never more than asked, never below the last rung."""

    def __init__(self, asked_fps: float, start_fps: float | None = None) -> None:
        """Begins at the highest rung that is at most `start_fps`, by default at the top."""
        self._rungs = rungs(asked_fps)
        start = asked_fps if start_fps is None else start_fps
        self._rung = self._highest(start, 0)
        self._last_ns: int | None = None
        self._ignored = STARTING  # observations from now on
        self._troubles = 0
        self._least_missed = 1.0  # in these
        self._calm_ns = 0
        self._raise_after_ns = [RAISE_AFTER_NS] * len(self._rungs)  # before each is tried
        self._changed_ns: int | None = None  # when the rate in force began

    @property
    def fps(self) -> float:
        """The rate in force."""
        return self._rungs[self._rung]

    def step(self, now_ns: int, seen: Observation) -> str:
        """Take what was seen until `now_ns`; why the rate changed in one clause, "" if not."""
        passed_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        if self._ignored:
            self._ignored -= 1
            return ""
        trouble = seen.trouble
        if trouble:
            self._troubles += 1
            self._least_missed = min(self._least_missed, seen.missed)
            self._calm_ns = 0
        else:
            self._troubles, self._least_missed = 0, 1.0
            self._calm_ns += passed_ns if seen.calm else 0
        if self._changed_ns is None:
            self._changed_ns = now_ns
        if now_ns - self._changed_ns > HOLDS_AFTER_NS:
            self._raise_after_ns[self._rung] = RAISE_AFTER_NS
        if self._troubles >= SUSTAINED and self._rung < len(self._rungs) - 1:
            doubled_ns = 2 * self._raise_after_ns[self._rung]
            self._raise_after_ns[self._rung] = min(doubled_ns, LONGEST_WAIT_NS)
            reached_fps = self.fps * (1.0 - self._least_missed) * _MEASURING
            self._change(now_ns, self._highest(reached_fps, self._rung + 1))
            return trouble
        if self._rung > 0 and self._calm_ns >= self._raise_after_ns[self._rung - 1]:
            calm_s = self._calm_ns / NS_PER_S
            self._change(now_ns, self._rung - 1)
            return f"the machine kept up for {calm_s:.0f} s"
        return ""

    def _change(self, now_ns: int, rung: int) -> None:
        self._rung, self._changed_ns = rung, now_ns
        self._ignored = SETTLING
        self._troubles, self._least_missed = 0, 1.0
        self._calm_ns = 0

    def _highest(self, fps: float, first: int) -> int:
        """The first rung from `first` on with at most `fps`, else the last one."""
        for rung in range(first, len(self._rungs)):
            if self._rungs[rung] <= fps:
                return rung
        return len(self._rungs) - 1

"""The cameras' frame rate: how many are given, who loses the others, and the steps down and up."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tams_app.config import Config
from tams_app.records import LATE_NS, CameraRates, Frame, Tick
from tams_app.robot.devices import Note
from tams_app.robot.listener import Listener
from tams_app.robot.rate_ladder import Observation, RateLadder
from tams_app.runtime.clock import Clock
from tams_app.summary.frame_rate import ENOUGH, shortfall
from tams_app.units import NS_PER_S

PERIOD_NS = NS_PER_S
MEASURED = "the machine was measured to hold no more at the start"
REPORTED_AFTER = 5  # periods in a row with too few frames
BEHIND_PERIODS = 1.5  # all the time; one period while a frame is in the encoder


@dataclass(slots=True)
class _Count:
    """One view's frames since its first; written by its capture thread alone."""

    due: int = 0
    taken: int = 0
    overrun: int = 0  # the camera had them, the session did not take them
    damaged: int = 0  # they arrived so, and were left out
    last_index: int | None = None
    free_ns: int = 0  # when the thread began to wait for the next frame

    def add(self, frame: Frame) -> None:
        self.damaged += frame.damaged
        if self.last_index is not None:
            left_out = frame.index - self.last_index - 1
            self.due += left_out + 1
            self.taken += 1
            if frame.capture_ns < self.free_ns:  # it was there before the thread waited for it
                self.overrun += left_out
        self.last_index = frame.index


@dataclass(frozen=True, slots=True)
class _Totals:
    """All that was counted until `t_ns`."""

    t_ns: int
    due: Mapping[str, int]
    taken: Mapping[str, int]
    overrun: Mapping[str, int]
    damaged: Mapping[str, int]
    ticks: int  # skipped ones among them
    late: int


class FrameRates(Listener):
    """Counts frames and late ticks; once a second it logs them and moves the ladder.

    Cameras without a ladder, all real ones among them, are never slowed, only reported. What
    `through` gives runs in the capture threads, `poll` in one other.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        ladder: RateLadder | None,
        ask_fps: Callable[[float], None],
        encoders_behind_ns: Callable[[], int],
        record: Callable[[CameraRates], None],
        note: Note,
    ) -> None:
        """`ask_fps` sets the cameras' rate; `encoders_behind_ns`: their cameras, now."""
        self._fps = float(config.video.fps)
        self._simulated = config.rig.enabled
        self._clock = clock
        self._ladder = ladder
        self._ask_fps = ask_fps
        self._encoders_behind_ns = encoders_behind_ns
        self._record = record
        self._note = note
        self._counts = {view: _Count() for view in config.video.views}
        self._ticks = self._late = self._skipped = 0
        self._before: _Totals | None = None
        self._least_behind_ns: int | None = None  # in this period
        self._short_periods = 0
        self.given_fps: Mapping[str, float] = {}  # by view, in the last period

    def through(self, push: Callable[[Frame], None]) -> Callable[[Frame], None]:
        """`push`, with the frames counted that pass."""

        def take(frame: Frame) -> None:
            count = self._counts[frame.view]
            count.add(frame)
            push(frame)
            count.free_ns = self._clock.now_ns()

        return take

    def on_tick(self, tick: Tick) -> None:
        self._ticks += 1
        self._late += tick.started_ns - tick.due_ns > LATE_NS
        self._skipped = tick.skipped

    def poll(self) -> None:
        """Look at the encoders now, and at everything once a period."""
        now_ns = self._clock.now_ns()
        if self._before is None:
            if self._ticks and all(count.due for count in self._counts.values()):
                self._before = self._totals(now_ns)
                reason = "" if self._asked_fps == self._fps else MEASURED
                self._record(CameraRates(now_ns, self._asked_fps, reason, {}, {}))
            return
        behind_ns, least_ns = self._encoders_behind_ns(), self._least_behind_ns
        self._least_behind_ns = behind_ns if least_ns is None else min(behind_ns, least_ns)
        if now_ns - self._before.t_ns >= PERIOD_NS:
            self._look(self._before, self._totals(now_ns))

    @property
    def _asked_fps(self) -> float:
        return self._ladder.fps if self._ladder else self._fps

    def _totals(self, now_ns: int) -> _Totals:
        skipped = self._skipped
        return _Totals(
            now_ns,
            {view: count.due for view, count in self._counts.items()},
            {view: count.taken for view, count in self._counts.items()},
            {view: count.overrun for view, count in self._counts.items()},
            {view: count.damaged for view, count in self._counts.items()},
            self._ticks + skipped,
            self._late + skipped,
        )

    def _look(self, before: _Totals, after: _Totals) -> None:
        taken = {view: after.taken[view] - before.taken[view] for view in self._counts}
        due = {view: after.due[view] - before.due[view] for view in self._counts}
        flowing = [view for view in due if due[view]]  # no frame at all: stale video is for that
        seen = Observation(
            missed=max((1.0 - taken[view] / due[view] for view in flowing), default=0.0),
            late=(after.late - before.late) / max(after.ticks - before.ticks, 1),
            encoder_behind=(self._least_behind_ns or 0)
            > BEHIND_PERIODS * NS_PER_S / self._asked_fps,
        )
        passed_s = (after.t_ns - before.t_ns) / NS_PER_S
        overrun = {view: after.overrun[view] - before.overrun[view] for view in self._counts}
        damaged = {view: after.damaged[view] - before.damaged[view] for view in self._counts}
        self.given_fps = {view: count / passed_s for view, count in taken.items()}
        overrun_fps = {view: count / passed_s for view, count in overrun.items()}
        self._before, self._least_behind_ns = after, None
        reason = ""
        if self._ladder is None:
            self._notify(overrun_fps, damaged)
        elif flowing:
            reason = self._climb(self._ladder, after.t_ns, seen)
        self._record(
            CameraRates(
                after.t_ns, self._asked_fps, reason, dict(self.given_fps), overrun_fps, damaged
            )
        )

    def _climb(self, ladder: RateLadder, now_ns: int, seen: Observation) -> str:
        """Move the ladder; why it has changed the rate, "" if it has not."""
        before_fps = ladder.fps
        reason = ladder.step(now_ns, seen)
        if reason:
            self._ask_fps(ladder.fps)
            self._note(
                "warning" if ladder.fps < before_fps else "info",
                f"the cameras now run at {ladder.fps:g} instead of {before_fps:g} frames per "
                f"second: {reason}",
            )
        return reason

    def _notify(self, overrun_fps: Mapping[str, float], damaged: Mapping[str, int]) -> None:
        """Report once each time in which too few frames come."""
        short = min(self.given_fps.values()) < ENOUGH * self._fps
        self._short_periods = self._short_periods + 1 if short else 0
        if self._short_periods == REPORTED_AFTER:
            self._note(
                "warning",
                shortfall(self._fps, self.given_fps, overrun_fps, self._simulated, damaged=damaged),
            )

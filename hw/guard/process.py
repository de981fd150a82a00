"""The guard: a helper process that stops the arm when the control loop's heartbeat ends.

`python -m hw.guard.process SPECIFICATION`, which is `guard_specification` as JSON; the ready line
holds the name of the `memory` for the heartbeats and the `scheduler` that was granted.
It has its own connections to the arm and shares nothing else with the application: one that was
killed, stopped or stalled still stops the arm. It reads the arm's own reports, too, and stops an
arm that moves as the beats do not say, or as none may (`motion.py`).
"""

from __future__ import annotations

import pkgutil
import time
from enum import Enum
from typing import TYPE_CHECKING, Any

from hw.guard.link import BEATS, GuardMemory, GuardMessage, Heartbeat, decode_heartbeat
from hw.guard.motion import Cause, MotionLimits, MotionWatch
from tams_app.errors import TamsError
from tams_app.runtime.clock import Clock, MonotonicClock, SleepWatch
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import GUARD_PRIORITY, use_fifo
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS

if TYPE_CHECKING:  # the guard starts in milliseconds
    from hw.arm import StopChannel
    from hw.arm_report import ReportWatch

POLL_S = 0.005  # a beat is heard this much later at most, and a silence seen
_KEPT_BEATS = BEATS.heads - 8  # the oldest may be overwritten while they are read
BLIND_NS = 1200 * NS_PER_MS  # without a report: later than *arm silent* of the control loop
FAREWELL_STOP_TIMEOUT_S = 2.0


class GuardWatch(Enum):
    """What the guard is doing."""

    IDLE = "idle"  # never armed, or disarmed
    ARMED = "armed"
    LATCHED = "latched"  # stopped the arm; only a new arming ends it


class HeartbeatWatch:
    """Whether the arm is watched, and when the heartbeat is lost.

    Pure: time and heartbeats come in, decisions go out.
    """

    def __init__(self, timeout_ns: int) -> None:
        self._timeout_ns = timeout_ns
        self.arming = self.sequence = 0  # of the newest beat that counted
        self._last_beat_ns = 0
        self.watch = GuardWatch.IDLE
        self.cause = Cause.NONE  # of the latch

    def hear(self, now_ns: int, heartbeat: Heartbeat) -> bool:
        """Take in one heartbeat; whether it counts: not a late one of an older or ended arming."""
        if heartbeat.arming < self.arming:
            return False
        if heartbeat.arming > self.arming:
            self._begin(now_ns, heartbeat)
            return True
        if self.watch is not GuardWatch.ARMED or heartbeat.sequence <= self.sequence:
            return False
        self._continue(now_ns, heartbeat)
        return True

    def lost(self, now_ns: int) -> bool:
        """True once when the heartbeat has been silent for too long; latches."""
        silent_ns = now_ns - self._last_beat_ns
        return silent_ns > self._timeout_ns and self.trip(Cause.SILENT)

    def trip(self, cause: Cause) -> bool:
        """Latch for `cause`; True if the arm is to be stopped for it, once for each arming."""
        if self.watch is not GuardWatch.ARMED:
            return False
        self.watch, self.cause = GuardWatch.LATCHED, cause
        return True

    def _begin(self, now_ns: int, heartbeat: Heartbeat) -> None:
        self.arming = heartbeat.arming
        self.watch, self.cause = GuardWatch.IDLE, Cause.NONE
        if heartbeat.message is GuardMessage.BEAT:
            self.watch = GuardWatch.ARMED
            self.sequence, self._last_beat_ns = heartbeat.sequence, now_ns

    def _continue(self, now_ns: int, heartbeat: Heartbeat) -> None:
        if heartbeat.message is GuardMessage.DISARM:
            self.watch = GuardWatch.IDLE
        elif heartbeat.message is GuardMessage.BEAT:
            self.sequence, self._last_beat_ns = heartbeat.sequence, now_ns


class Guard:
    """Joins heartbeat, reports, watches and stop; `step` is its loop's body."""

    def __init__(
        self,
        memory: GuardMemory,
        watch: HeartbeatWatch,
        motion: MotionWatch,
        arm: StopChannel,
        reports: ReportWatch,
        clock: Clock,
    ) -> None:
        self._memory = memory
        self._watch = watch
        self._motion = motion
        self._arm = arm
        self._reports = reports
        self._clock = clock
        self._sleep = SleepWatch(clock)
        self._arming = 0  # whose motion is watched
        self._reported_ns = clock.now_ns()
        self._heard = 0  # beats

    def step(self) -> None:
        """Hear and answer the heartbeats, look at the arm, and stop it if it must not go on.

        The stop is told to the application unasked: its next tick knows why the arm stands.
        """
        self._hear()
        cause = self._look()
        if (cause and self._watch.trip(cause)) or self._watch.lost(self._clock.now_ns()):
            self._arm.request_stop()
            self._answer(self._watch.arming, self._watch.sequence)

    def farewell(self) -> None:
        """The parent is gone or ends the guard: stop the arm if it was still armed."""
        try:
            self._hear()  # that it was disarmed just before
        finally:  # also where hearing is what has failed
            if self._watch.watch is GuardWatch.ARMED:
                self._arm.request_stop()
            if self._arm.pending:
                self._arm.wait_acknowledged(FAREWELL_STOP_TIMEOUT_S)

    def _hear(self) -> None:
        """Everything new, before silence is judged.

        A guard that was itself stalled must not take its own absence for the application's.
        """
        beats = self._memory.beats
        written = beats.written()
        self._heard = max(self._heard, written - _KEPT_BEATS)
        while self._heard < written:
            record = beats.head(self._heard)
            if record is None:  # not to be seen whole yet
                return
            self._heard += 1
            heartbeat = decode_heartbeat(record)
            if heartbeat is not None:
                self._take(self._clock.now_ns(), heartbeat)
                self._answer(heartbeat.arming, heartbeat.sequence)

    def _take(self, now_ns: int, heartbeat: Heartbeat) -> None:
        if not self._watch.hear(now_ns, heartbeat) or self._watch.watch is not GuardWatch.ARMED:
            return
        if heartbeat.arming != self._arming:
            self._arming = heartbeat.arming
            self._motion.begin(now_ns)
        self._motion.hear(now_ns, heartbeat.commanded, heartbeat.speed)

    def _look(self) -> Cause:
        """Judge the newest report, if one has come; older ones that waited say nothing of now."""
        if self._sleep.slept():
            return Cause.SLEPT
        before_ns = self._clock.now_ns()
        report = self._reports.newest(before_ns)
        if report is None:
            return Cause.NONE
        self._reported_ns = self._clock.now_ns()
        if self._watch.watch is not GuardWatch.ARMED:
            return Cause.NONE
        return self._motion.look(before_ns, self._reported_ns, report)

    def _answer(self, arming: int, sequence: int) -> None:
        is_blind = self._clock.now_ns() - self._reported_ns > BLIND_NS
        answer = Heartbeat(
            GuardMessage.ACKNOWLEDGEMENT,
            arming,
            sequence,
            latched=self._watch.watch is GuardWatch.LATCHED,
            arm_lost=bool(self._arm.failure) or is_blind,
            cause=self._watch.cause,
        )
        self._memory.answers.put(answer.encode())


def main() -> None:
    """The process: set up, say ready, watch until told to end."""
    side = HelperSide()
    scheduler = use_fifo(GUARD_PRIORITY)
    specification = side.specification
    arm = _stop_channel(specification)
    reports = _report_watch(specification)
    watch = HeartbeatWatch(round(specification["heartbeat_timeout_ms"] * NS_PER_MS))
    motion = MotionWatch(MotionLimits(**specification["motion"]))
    try:
        arm.start()
        reports.start()
    except TamsError as error:
        side.fail(str(error))
        return
    name = new_block_name()
    memory = GuardMemory(name)
    try:
        guard = Guard(memory, watch, motion, arm, reports, MonotonicClock())
        side.ready(memory=name, scheduler=scheduler)
        try:
            while not side.stop_requested.is_set():
                guard.step()
                time.sleep(POLL_S)
        finally:  # a guard that fails does not wait for the application to see it
            guard.farewell()
    finally:
        reports.close()
        arm.close()
        memory.hide()
        memory.close()


def _stop_channel(specification: dict[str, Any]) -> StopChannel:
    """The stop channel of the configured arm's kind, not connected yet."""
    channel: StopChannel = pkgutil.resolve_name(specification["stop_channel"])(
        specification["host"],
        specification["control_port"],
        specification["reply_timeout_s"],
        name="guard-stop",
    )
    return channel


def _report_watch(specification: dict[str, Any]) -> ReportWatch:
    """The reports of the configured arm's kind, not connected yet."""
    watch: ReportWatch = pkgutil.resolve_name(specification["report_watch"])(
        specification["host"], specification["report_port"]
    )
    return watch


if __name__ == "__main__":
    main()

"""The guard process as the session sees it: armed with the arm, fed by the control loop."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from hw.arm import Arm
from hw.guard.link import GuardLink, GuardMemory, guard_specification
from hw.guard.motion import Cause, Motion
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError, TamsError
from tams_app.records import Record, TakeNote, Tick
from tams_app.robot.control import Signals
from tams_app.robot.listener import Listener
from tams_app.runtime.process import HelperProcess
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS

SILENCE_NS = 200 * NS_PER_MS  # without an answer the arm has no guard

_REASONS = {
    Cause.NONE: Reason.GUARD_STOPPED,
    Cause.SILENT: Reason.GUARD_STOPPED,
    Cause.UNASKED: Reason.ARM_MOVED_UNASKED,
    Cause.TOO_FAST: Reason.ARM_TOO_FAST,
    Cause.OUTSIDE: Reason.ARM_OUTSIDE,
    Cause.SLEPT: Reason.COMPUTER_SLEPT,
}


class Guarding(Listener):
    """Starts the guard, beats it from the control loop, turns its silence and stops into faults."""

    def __init__(
        self,
        arm: ArmConfig,
        limits: LimitsConfig,
        log_directory: Path | None,
        signals: Signals,
        note: TakeNote,
        home_rad_s: float | None = None,
    ) -> None:
        """`home_rad_s`: of the fastest joint; an ENGAGED arm moves to its ready pose by itself then
        and follows no hand.
        """
        specification = guard_specification(arm, limits)
        self.process = HelperProcess("guard", "hw.guard.process", specification, log_directory)
        self._signals = signals
        self._note = note
        self._latched = False
        self._silent = False  # while the arm was armed, and has not answered since
        self._link: GuardLink | None = None
        self._home_rad_s = home_rad_s
        self._timeout_ns = round(arm.guard.heartbeat_timeout_ms * NS_PER_MS)
        self._beat_ns = 0
        self._commanded = (Motion.REST, False, 0.0)  # in the last tick: motion, deadman, speed

    def join(self, arm: Arm, stack: ExitStack, connect: Callable[[], None]) -> None:
        """Start the guard, `connect` the arm, and wait for the guard; `stack` ends both.

        In reverse: the arm must stand before the guard lets go of it.
        """
        stack.callback(self.close)
        self.start()
        stack.push(_closing(arm))
        connect()
        self.wait_ready()

    def start(self) -> None:
        """Start the process without waiting; see `wait_ready`."""
        self.process.start()

    def wait_ready(self) -> None:
        """Connect to the guard; HelperError if it could not start."""
        ready = self.process.wait_ready()
        memory = GuardMemory(str(ready["memory"]))
        self._link = GuardLink(memory, SILENCE_NS, lambda: self.process.exit_code is None)

    def receive(self, record: Record) -> None:
        """Arm and disarm the guard with the arm; it stays armed while the arm is being stopped.

        What was commanded is in the next beat.
        """
        if not isinstance(record, Tick):
            return
        arming, link = ArmingState(record.arming), self._link
        self._commanded = self._command(record, arming)
        wanted = arming.is_armed or (record.stop and link is not None and link.armed)
        if link is None or link.armed == wanted:
            return
        if wanted:
            link.arm()
        else:
            link.disarm()

    def before_tick(self, now_ns: int) -> None:
        """One heartbeat, and what the guard reported becomes a fault of the tick that begins."""
        link = self._link
        if link is None:
            return
        self._beat_ns = now_ns
        link.beat(now_ns, *self._commanded)
        if link.latched and not self._latched:
            reason = _REASONS[link.cause]
            self._note("warning", f"the guard process has stopped the arm: {reason.label}")
            self._signals.trip(reason)
        self._latched = link.latched
        if not link.answers(now_ns):
            self._silent = True
        elif link.is_fresh(now_ns):
            self._silent = False
        if self._silent and link.ended:
            self._signals.fault(Reason.GUARD_LOST)
        elif self._silent:
            self._signals.trip(Reason.GUARD_SILENT)  # in each tick, until it is back
        elif link.arm_lost:
            self._signals.trip(Reason.GUARD_BLIND)  # in each tick, until it is back

    def watches(self, now_ns: int) -> bool:
        """Whether the guard has acknowledged this arming and has had no cause to stop the arm.

        From any thread; the last beat may be too old for it by now.
        """
        link = self._link
        is_beaten = now_ns - self._beat_ns <= self._timeout_ns
        return link is not None and link.acknowledged and not link.latched and is_beaten

    def _command(self, tick: Tick, arming: ArmingState) -> tuple[Motion, bool, float]:
        engaged, home_rad_s = arming is ArmingState.ENGAGED, self._home_rad_s
        if engaged and home_rad_s is not None:
            return Motion.HOME, tick.deadman, home_rad_s
        speed = float(np.linalg.norm(tick.twist.linear))
        return Motion.FOLLOW if engaged else Motion.REST, tick.deadman, speed

    def close(self) -> None:
        """Disarm and end the guard; the arm must have been stopped before."""
        if self._link is not None:
            self._link.close()
        self.process.stop()


def _closing(arm: Arm) -> Callable[[object, BaseException | None, object], None]:
    """Closes the arm; that its stop was not acknowledged must not hide what happened before."""

    def close(_kind: object, error: BaseException | None, _trace: object) -> None:
        try:
            arm.close()
        except DeviceError as unstopped:
            if not isinstance(error, TamsError):
                raise
            before, after = str(error).rstrip("."), str(unstopped)
            raise DeviceError(f"{before}; and {after[0].lower()}{after[1:]}") from error

    return close

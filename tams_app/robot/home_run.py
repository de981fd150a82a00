"""Moves the arm to its ready pose while the operator holds Enter; see `homing.py`."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np

from hw.arm import Arm
from hw.guard.motion import Cause, Motion
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.records import Activity
from tams_app.robot.homing import (
    Action,
    Homing,
    HomingInput,
    HomingPath,
    HomingState,
    path_to_ready,
)
from tams_app.runtime.clock import Clock, SleepWatch
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS, NS_PER_S

POLL_S = 0.01  # also the period of the guard's heartbeat
PROGRESS_NS = NS_PER_S
START_TIMEOUT_S = 10.0  # of the replies and reports that starting waits for
_DEADMAN = b"\r\n"
_TOO_BUSY = "The guard stopped the arm: this computer was too busy; close other programs."
_SLEPT = "This computer was suspended; see where the arm is, then start again."
_STOPPED = {
    Cause.NONE: _TOO_BUSY,
    Cause.SILENT: _TOO_BUSY,
    Cause.UNASKED: "The guard stopped the arm: it moved unasked; find out what else commands it.",
    Cause.TOO_FAST: "The guard stopped the arm: it moved faster than it may; find out why.",
    Cause.OUTSIDE: "The guard stopped the arm: it came below limits.floor_mm; find out why.",
    Cause.SLEPT: _SLEPT,
}
_COMMANDED = (HomingState.STARTING, HomingState.MOVING)  # the arm moves, and the key is held

_SAY = {
    HomingState.WAITING: "The arm stands. Hold Enter to go on; space, Esc or any other key ends.",
    HomingState.STARTING: "Releasing the brakes ...",
    HomingState.MOVING: "Moving. Let go of Enter to stop.",
    HomingState.DONE: "The arm is in its ready pose.",
    HomingState.ENDED: "Ended before the arm was in its ready pose.",
}


class Guard(Protocol):
    """What stops the arm if this process does not live on; `hw.guard.link.GuardLink` is one."""

    latched: bool
    cause: Cause  # of the latch

    @property
    def acknowledged(self) -> bool: ...

    def arm(self) -> None: ...

    def disarm(self) -> None: ...

    def beat(self, now_ns: int, motion: Motion, deadman: bool, speed: float) -> None: ...

    def alive(self, now_ns: int) -> bool: ...


class HomeRun:
    """One motion to the ready pose: the loop around `Homing`, for the main thread.

    `read_keys(timeout_s)` returns what the terminal sent meanwhile. Starting the move may wait for
    the arm, which the key and the heartbeat cannot: it is done in a thread. Nor can they wait for
    a screen: `say` must not block. `all_shown` tells when the operator can have read it, and until
    then a press starts nothing.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        arm: Arm,
        guard: Guard,
        read_keys: Callable[[float], bytes],
        say: Callable[[str], None],
        all_shown: Callable[[], bool],
    ) -> None:
        self._clock, self._arm, self._guard = clock, arm, guard
        self._read_keys, self._say, self._all_shown = read_keys, say, all_shown
        self._config = config
        self._sleep = SleepWatch(clock)
        self._watch_ns = round(config.arm.guard.heartbeat_timeout_ms * NS_PER_MS)
        self._beat_ns = 0
        self._stopped_ns = 0  # when the arm was told to stop last
        self._speed_rad_s = math.radians(config.arm.ready_speed_deg_s)
        self._starting: Worker | None = None
        self._said: HomingState | None = None
        self._progress_ns = 0
        self._path = path_to_ready(config, self._joints())
        self._homing = Homing(self._path.goal)

    def run(self) -> HomingState:
        """DONE or ENDED, the arm stopped; DeviceError, with the arm stopped, if it failed."""
        self._say(describe_path(self._path, self._speed_rad_s))
        try:
            while not self._homing.over:
                self._step(self._read_keys(POLL_S))
        finally:
            self._arm.stop()
            if self._starting is not None:
                self._starting.join(START_TIMEOUT_S)
        if self._homing.state is HomingState.FAILED:
            raise DeviceError(self._homing.reason)
        return self._homing.state

    def _step(self, keys: bytes) -> None:
        now_ns = self._clock.now_ns()
        self._beat(now_ns)
        began, refused = self._start_result()
        problem = self._guard_problem(now_ns)
        if problem:  # what the guard did is the reason; that the arm then refused follows from it
            refused = ""
        action = self._homing.step(
            HomingInput(
                now_ns,
                self._counts(keys),
                any(key not in _DEADMAN for key in keys),
                self._arm.state(),
                self._arm.link(),
                began,
                refused,
                self._guard.acknowledged,
                problem,
            )
        )
        if action is Action.STOP:
            self._stopped_ns = now_ns
            self._arm.stop()
        elif action is Action.ARM:
            self._arm_guard()
        elif action is Action.START:
            self._starting = Worker("arm-homing", self._begin_move, lambda *_: None)
            self._starting.start()
        if self._homing.state is HomingState.WAITING and self._has_stopped():
            self._guard.disarm()  # from here on the arm may be guided by hand
        self._tell(now_ns)

    def _counts(self, keys: bytes) -> bool:
        """Whether the deadman key was pressed, for what the operator has seen."""
        if self._homing.state is HomingState.WAITING and not self._all_shown():
            return False
        return any(key in _DEADMAN for key in keys)

    def _arm_guard(self) -> None:
        """Have the guard watch, if the path from here is still the one that was shown.

        An arm that was moved by hand meanwhile gets a path of its own, shown and held for anew.
        """
        path = path_to_ready(self._config, self._joints())
        if not self._path.passes(path.start):
            self._path, self._homing = path, Homing(path.goal)
            self._said = None
            self._say(describe_path(path, self._speed_rad_s))
            return
        self._guard.arm()
        self._beat(self._clock.now_ns())

    def _beat(self, now_ns: int) -> None:
        commands = self._homing.state in _COMMANDED
        motion = Motion.HOME if commands else Motion.REST
        self._guard.beat(now_ns, motion, commands, self._speed_rad_s if commands else 0.0)
        self._beat_ns = now_ns

    def _begin_move(self, _stop: threading.Event) -> None:
        """In the thread: a guard that stopped the arm while it got ready stops it only once."""
        self._arm.begin_move_to_joints(self._path.goal.tolist(), self._speed_rad_s)
        if self._clock.now_ns() - self._beat_ns > self._watch_ns:
            self._arm.stop()
            raise DeviceError(_TOO_BUSY)

    def _start_result(self) -> tuple[bool, str]:
        """Whether the move that was started has begun, or why not; once."""
        starting = self._starting
        if starting is None or starting.alive:
            return False, ""
        self._starting = None
        if isinstance(starting.failure, DeviceError):
            return False, str(starting.failure)
        if starting.failure is not None:
            raise starting.failure
        return True, ""

    def _has_stopped(self) -> bool:
        """Whether the arm has reported so since it was told to."""
        arm = self._arm.state()
        return (
            arm is not None
            and arm.activity is Activity.STOPPED
            and arm.received_ns > self._stopped_ns
        )

    def _guard_problem(self, now_ns: int) -> str:
        if self._sleep.slept():
            return _SLEPT
        if not self._guard.alive(now_ns):
            return "The guard process does not answer; start again."
        if self._guard.latched and self._homing.state is not HomingState.WAITING:
            return _STOPPED[self._guard.cause]
        return ""

    def _tell(self, now_ns: int) -> None:
        state = self._homing.state
        if state is not self._said:
            self._said = state
            if state in _SAY:
                self._say(_SAY[state])
            self._progress_ns = now_ns
        elif state is HomingState.MOVING and now_ns - self._progress_ns >= PROGRESS_NS:
            self._progress_ns = now_ns
            left = float(np.abs(self._path.goal - self._joints()).max())
            self._say(f"{math.degrees(left):.0f}° to go")

    def _joints(self) -> np.ndarray:
        state = self._arm.state()
        if state is None:
            raise DeviceError("The arm sends no reports; restart its control box.")
        return state.joints


def describe_path(path: HomingPath, speed_rad_s: float) -> str:
    """Where the arm is, where it will go, and how far that is."""
    rows = [
        f"joints now    {_degrees(path.start)}",
        f"ready pose    {_degrees(path.goal)}",
        f"on its path   {math.degrees(path.travel_rad):.0f}° of the joint that turns most, "
        f"{path.tcp_path_m * 1000:.0f} mm of the gripper, lowest {path.lowest_m * 1000:.0f} mm; "
        f"{path.duration_s(speed_rad_s):.0f} s",
    ]
    return "\n".join(rows)


def _degrees(joints: np.ndarray) -> str:
    return " ".join(f"{math.degrees(joint):7.1f}" for joint in joints) + "  °"

"""Moves the arm to its ready pose while the operator holds Enter; see `homing.py`."""

from __future__ import annotations

import math

import numpy as np

from hw.arm import Arm
from hw.controller import Controller
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.policy.inference import INFERENCES
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.control import ControlLoop, LoopDevices, Signals, SteadyVideo
from tams_app.robot.guarding import Guarding
from tams_app.robot.homing import Homing, HomingPath, HomingState, advice_at_home
from tams_app.rotation import Rotation
from tams_app.runtime.clock import Clock
from tams_app.teleop.safety import Reason
from tams_app.units import NS_PER_S

POLL_S = 0.01  # also the period of the guard's heartbeat
PROGRESS_NS = NS_PER_S
_DEADMAN = b"\r\n"
_POSE = Pose(np.zeros(3), Rotation.identity())  # a key has none, and steers nothing

_SENTENCES = {
    HomingState.WAITING: "The arm stands. Hold Enter to go on; space, Esc or any other key ends.",
    HomingState.STARTING: "Releasing the brakes ...",
    HomingState.MOVING: "Moving. Let go of Enter to stop.",
    HomingState.DONE: "The arm is in its ready pose.",
    HomingState.ENDED: "Ended before the arm was in its ready pose.",
}


class EnterKey(Controller):
    """A terminal as the operator's hand: Enter is its trigger, any other key an emergency stop."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self._pressed = False

    def feed(self, keys: bytes) -> None:
        """What the terminal has sent since the last tick."""
        if keys.strip(_DEADMAN):
            self._signals.estop()
        self._pressed = bool(keys)

    def sample(self, now_ns: int) -> ControllerSample:
        pressed, status = float(self._pressed), ControllerStatus.OK
        return ControllerSample.released(status, _POSE, now_ns, now_ns, pressed)

    def start(self) -> None:
        """The terminal is open already."""

    def pulse(self, haptic: Haptic) -> None:
        """It has nothing to shake."""

    def close(self) -> None:
        """Who opened the terminal closes it."""


class HomeRun:
    """One motion to the ready pose: `Homing` in a session's control loop, for the main thread.

    A context, whose end stops the arm: `step` it every `POLL_S` until it is `over`. `gate` is to be
    run in a thread: what waits for the arm's replies keeps neither key nor heartbeat waiting. Nor
    may what shows the sentences wait for a screen.
    """

    def __init__(
        self, config: Config, clock: Clock, arm: Arm, guard: Guarding, signals: Signals
    ) -> None:
        """`arm` is connected, and `guard` ready: it knows `signals` and the speed on this way."""
        self._clock, self._arm, self._guard = clock, arm, guard
        self._speed_rad_s = math.radians(config.arm.ready_speed_deg_s)
        state = arm.state()
        if state is None:
            raise DeviceError("The arm sends no reports; restart its control box.")
        self._homing = homing = Homing(config, state.joints, guard.watches)
        self._shown: tuple[HomingPath | None, HomingState | None] = (None, None)
        self._progress_ns = 0
        self._key = EnterKey(signals)
        self.gate = ArmGate(arm, None, self._note, self._begin)
        self._control = ControlLoop(
            config,
            clock,
            LoopDevices(self._key, arm, self.gate, SteadyVideo()),
            signals,
            homing,
            INFERENCES[config.policy.phases.inference](config.policy.phases),
            (guard,),
        )

    def __enter__(self) -> HomeRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.gate.stop()

    @property
    def over(self) -> bool:
        """It is there, was ended, or has failed."""
        return self._homing.over

    def step(self, keys: bytes, all_shown: bool) -> list[str]:
        """One control period; the sentences for the operator.

        `keys`: what the terminal has sent since the last. `all_shown`: the operator can have read
        all sentences so far.
        """
        self._homing.all_shown = all_shown
        self._key.feed(keys)
        self._control.tick(self._clock.now_ns())
        return self.sentences()

    @property
    def result(self) -> HomingState:
        """DONE or ENDED; DeviceError if it failed."""
        if self._homing.state is HomingState.FAILED:
            raise DeviceError(self._homing.failure)
        return self._homing.state

    def _begin(self) -> None:
        """In the gate's thread: a guard that stopped the arm while it got ready did so only once.

        Its stop may have come before the move, and this loop may stand still.
        """
        self._arm.begin_move_to_joints(self._homing.path.goal.tolist(), self._speed_rad_s)
        if not self._guard.watches(self._clock.now_ns()):
            self._arm.stop()
            raise DeviceError(advice_at_home(Reason.GUARD_STOPPED))

    def _note(self, level: str, text: str) -> None:
        """Of the gate: an error is a move that did not begin."""
        if level == "error":
            self._homing.refusal = text

    def sentences(self) -> list[str]:
        """Those that are new: the path, the state, the progress."""
        homing, now_ns = self._homing, self._clock.now_ns()
        path, state = self._shown
        self._shown = homing.path, homing.state
        found = []
        if homing.path is not path:
            found.append(describe_path(homing.path, self._speed_rad_s))
        if homing.state is not state or homing.path is not path:
            if homing.state in _SENTENCES:
                found.append(_SENTENCES[homing.state])
            self._progress_ns = now_ns
        elif state is HomingState.MOVING and now_ns - self._progress_ns >= PROGRESS_NS:
            self._progress_ns = now_ns
            if (arm := self._arm.state()) is not None:
                found.append(f"{math.degrees(homing.path.left_rad(arm.joints)):.0f}° to go")
        return found


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

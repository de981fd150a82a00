"""A hand, an arm that integrates what it is told, and a bench that joins them to Teleop."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tams_app.config import Config, load_config
from tams_app.records import (
    Activity,
    ArmFault,
    ArmState,
    CommandLink,
    ControllerSample,
    ControllerStatus,
    Pose,
    ServoMode,
    Twist,
)
from tams_app.rotation import Rotation
from tams_app.teleop.loop import Teleop
from tams_app.teleop.records import TeleopInput, TeleopOutput
from tams_app.teleop.safety import ArmingState
from tams_app.vectors import times

PERIOD_NS = 8_333_333
READY_ROTATION = Rotation.from_rotvec((np.pi, 0.0, 0.0))
READY_POSITION = (0.35, 0.0, 0.18)


def make_config(**overrides: Any) -> Config:
    """The default configuration, with dotted keys written `limits__max_speed_mm_s`."""
    return load_config(overrides={key.replace("__", "."): v for key, v in overrides.items()})


class RoomyModel:
    """Kinematics without a singularity: each joint speed is one component of the twist."""

    joint_speed_limits = np.full(6, np.pi)
    joint_ranges = ((-np.inf, np.inf),) * 6

    def jacobian(self, joints: np.ndarray) -> np.ndarray:
        return np.eye(6)


class IntegratingArm:
    """Follows twists exactly, `delay_ticks` late, and reports at once."""

    def __init__(self, position: tuple[float, ...] = READY_POSITION, delay_ticks: int = 0) -> None:
        self.pose = Pose(np.array(position), READY_ROTATION)
        self.servo: ServoMode | None = ServoMode.VELOCITY
        self.activity = Activity.IDLE
        self.fault: ArmFault | None = None
        self._queue: deque[Twist] = deque([Twist.zero()] * delay_ticks)
        self.trail = [self.pose]

    def follow(self, output: TeleopOutput, interval_s: float) -> None:
        """Do for `interval_s` what `output` commands."""
        if output.stop:
            self.activity = Activity.STOPPED
        self._queue.append(output.twist if output.twist is not None else Twist.zero())
        twist = self._queue.popleft()
        self.pose = Pose(
            self.pose.position + np.array(twist.linear) * interval_s,
            self.pose.rotation.turned(times(twist.angular, interval_s)),
        )
        self.trail.append(self.pose)

    def report(self, now_ns: int) -> ArmState:
        return ArmState(now_ns, np.zeros(6), self.pose, self.activity, self.servo, self.fault, None)


@dataclass
class Hand:
    """A controller whose pose is moved by hand velocities in the tracking frame."""

    position: np.ndarray = field(default_factory=lambda: np.array([0.0, 1.0, -0.3]))
    rotation: Rotation = field(default_factory=Rotation.identity)
    linear: np.ndarray = field(default_factory=lambda: np.zeros(3))
    angular: np.ndarray = field(default_factory=lambda: np.zeros(3))
    trigger: float = 0.0
    grip: float = 0.0
    a: bool = False
    b: bool = False
    menu: bool = False
    status: ControllerStatus = ControllerStatus.OK

    def sample(self, now_ns: int, interval_s: float) -> ControllerSample:
        self.position = self.position + self.linear * interval_s
        self.rotation = Rotation.from_rotvec(self.angular * interval_s) * self.rotation
        return ControllerSample(
            self.status,
            Pose(self.position, self.rotation),
            now_ns,
            now_ns,
            self.trigger,
            self.grip,
            self.a,
            self.b,
            self.menu,
        )


def hand_for(base_velocity: Any, config: Config) -> np.ndarray:
    """The hand's velocity that asks for `base_velocity` in the arm's base frame."""
    return np.array(config.hand.rotation).T @ np.array(base_velocity, dtype=float)


class Bench:
    """Steps Teleop in virtual time and keeps every output."""

    def __init__(
        self,
        config: Config | None = None,
        arm: IntegratingArm | None = None,
        model: Any = None,
        video_floor_ns: int = 0,
    ) -> None:
        self.config = config or make_config()
        self.arm = arm or IntegratingArm()
        self.hand = Hand()
        self.teleop = Teleop(self.config, model or RoomyModel(), READY_ROTATION, video_floor_ns)
        self.now_ns = 1_000_000_000
        self.outputs: list[TeleopOutput] = []
        self.times_ns: list[int] = []
        self.arm_ready = False
        self._last_ns: int | None = None

    def tick(self, period_ns: int = PERIOD_NS, **changes: Any) -> TeleopOutput:
        """One tick, `period_ns` after the last; `changes` replace fields of the input.

        The arm does what the last output said until this tick.
        """
        self.now_ns += period_ns
        interval_s = max(0, period_ns) / 1e9
        if self.outputs:
            self.arm.follow(self.outputs[-1], interval_s)
        sample = changes.pop("sample", None) or self.hand.sample(self.now_ns, interval_s)
        given = TeleopInput(
            now_ns=self.now_ns,
            sample=sample,
            arm=self.arm.report(self.now_ns),
            link=CommandLink(0, self.now_ns, 1_000_000, 0, ""),
            arm_ready=self.arm_ready,
            video_age_ns=None,
            confirm=False,
            estop=False,
        )
        output = self.teleop.step(replace(given, **changes))
        self.outputs.append(output)
        self.times_ns.append(self.now_ns)
        return output

    def run(self, ticks: int, **changes: Any) -> TeleopOutput:
        for _ in range(ticks):
            output = self.tick(**changes)
        return output

    def make_ready(self) -> None:
        self.tick()
        self.arm_ready = True
        self.tick(confirm=True)
        assert self.outputs[-1].arming is ArmingState.READY

    def engage(self) -> TeleopOutput:
        if not self.outputs:
            self.make_ready()
        self.hand.trigger = 1.0
        output = self.tick()
        assert output.arming is ArmingState.ENGAGED
        return output

    def ask(self, *base_velocity: float) -> None:
        """Move the hand so that it asks for this velocity [m/s] in the base frame."""
        self.hand.linear = hand_for(base_velocity, self.config)

    def ask_turn(self, *base_angular: float) -> None:
        self.hand.angular = hand_for(base_angular, self.config)

    def linear(self) -> np.ndarray:
        """Commanded linear velocities, (ticks, 3); zero where nothing was sent."""
        return np.array(
            [o.twist.linear if o.twist is not None else np.zeros(3) for o in self.outputs]
        )

    def angular(self) -> np.ndarray:
        return np.array(
            [o.twist.angular if o.twist is not None else np.zeros(3) for o in self.outputs]
        )

    def path(self) -> np.ndarray:
        """Positions the arm has been at, (ticks, 3)."""
        return np.array([pose.position for pose in self.arm.trail])

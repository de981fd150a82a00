"""Both sides of a link in virtual time: a hand here, Teleop and an arm with joints there."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from hw.lite6.kinematics import Lite6Model
from tams_app.prediction.forward_model import ArmHeard, ForwardModel
from tams_app.records import Activity, ArmState, ControllerSample, ServoMode, Twist
from tams_app.rotation import Rotation
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState
from tests.teleop.rig import PERIOD_NS, Bench, Hand, hand_for, make_config

READY_JOINTS = np.radians([0.0, 9.9, 31.8, 0.0, 21.9, 0.0])
MODEL = Lite6Model()


class JointArm:
    """Follows twists exactly, by its joints, `lag` ticks late, and reports at once."""

    def __init__(self, lag: int = 0) -> None:
        self.joints = READY_JOINTS.copy()
        self._coming: deque[Twist | None] = deque([None] * lag)

    def follow(self, output: TeleopOutput, interval_s: float) -> None:
        self._coming.append(output.twist)
        told = self._coming.popleft()
        if told is not None:
            twist = (*told.linear, *told.angular)
            speeds = np.linalg.solve(MODEL.jacobian(self.joints), twist)
            self.joints = self.joints + speeds * interval_s

    def report(self, now_ns: int) -> ArmState:
        pose, moving = MODEL.tcp_pose(self.joints), Activity.MOVING
        return ArmState(now_ns, self.joints, pose, moving, ServoMode.VELOCITY, None, None)


class Sides:
    """Samples take `way` ticks to the robot's side, states `back` ticks from there."""

    def __init__(self, way: int, back: int, lag: int = 0) -> None:
        """`lag`: ticks until a command shows in the joints."""
        self.config, self._lag = make_config(), lag
        self.hand, self.arm = Hand(), JointArm(lag)
        self._bench = Bench(self.config, self.arm, MODEL)  # type: ignore[arg-type]
        self.model = ForwardModel(self.config, MODEL, self.ready)
        self.way, self.back = way, back
        self._samples: list[tuple[int, ControllerSample]] = []
        self._states: list[ArmHeard] = []
        self._bench.make_ready()

    @property
    def ready(self) -> Rotation:
        return MODEL.tcp_pose(READY_JOINTS).rotation

    @property
    def now_ns(self) -> int:
        return self._bench.now_ns

    @property
    def output(self) -> TeleopOutput:
        return self._bench.outputs[-1]

    def step(self, ticks: int = 1, **changes: object) -> None:
        """Let so many ticks pass; `changes` replace fields of the robot's inputs."""
        for _ in range(ticks):
            self._tick(**changes)

    def _tick(self, **changes: object) -> None:
        now_ns = self.now_ns + PERIOD_NS
        sample = self.hand.sample(now_ns, PERIOD_NS / 1e9)
        self.model.sent(sample, now_ns)
        self._samples.append((now_ns, sample))
        sent_ns, sample = self._samples[max(0, len(self._samples) - 1 - self.way)]
        late_ns = now_ns - sent_ns
        there = replace(
            sample, pose_ns=sample.pose_ns + late_ns, buttons_ns=sample.buttons_ns + late_ns
        )
        output = self._bench.tick(sample=there, **changes)
        self._states.append(
            ArmHeard(
                t_ns=now_ns,
                joints=self.arm.joints,
                until_ns=sent_ns,
                arming=output.arming,
                orientation_mode=output.orientation_mode,
                speed_scale=output.speed_scale,
                lag_ns=self._lag * PERIOD_NS,
            )
        )
        if len(self._states) > self.back:
            self.model.heard(self._states[-1 - self.back], self.way * PERIOD_NS)

    def engage(self) -> None:
        """Press the trigger and wait until both sides know."""
        self.step(self.way + self.back + 2)
        self.hand.trigger = 1.0
        self.step(self.way + self.back + 2)
        assert self.output.arming is ArmingState.ENGAGED

    def move(self, *velocity_m_s: float) -> None:
        """Engage, and lead the arm at this velocity from now on."""
        self.engage()
        self.hand.linear = hand_for(velocity_m_s, self.config)

    def errors_m(self, ticks: int, **changes: object) -> list[float]:
        """How far off each prediction is while so many ticks pass."""
        errors = []
        for _ in range(ticks):
            self.step(**changes)
            errors.append(self.error_m())
        return errors

    def error_m(self) -> float:
        """How far the TCP is from where it is predicted now."""
        forecast = self.model.at(self.now_ns)
        apart = MODEL.tcp_pose(forecast.joints).position - MODEL.tcp_pose(self.arm.joints).position
        return float(np.linalg.norm(apart))

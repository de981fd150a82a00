"""A robot for the operator's tests: the design's teleoperation law and contact, both roughly."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hw.sim.layout import (
    BLOCK_EDGE_M,
    BLOCK_HEIGHT_M,
    CONTAINER_INNER_M,
    Layout,
    Placement,
)
from hw.sim.operator.demo import TruePerception
from hw.sim.operator.operator import SimulatedOperator
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.task import Stage
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import HandConfig, OperatorConfig, load_config
from tams_app.records import ControllerSample, Haptic, Pose, SceneTruth, Vector
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S

TICK_NS = round(NS_PER_S / 120)
SMOOTHING_S = 0.04
SPEED_M_S, TURN_RAD_S = 0.25, 0.5
ACCELERATION_M_S2, ACCELERATION_RAD_S2 = 1.5, 4.0
FINGERS_M_S = 0.02
OPEN_M = 0.016
_WIRING = rig_wiring(load_config())


class ToyRobot:
    """Armed by the menu, moved by hand velocities while engaged, with a following lag."""

    def __init__(self, layout: Layout, mapping: Rotation, scale: float, lag_s: float) -> None:
        self.arming = "disarmed"
        self.held = False  # a cause for HOLDING is present
        self.deaf = False  # engaged, and yet it does not follow
        self.turning = False
        self.toggles = self.engagements = 0
        self.position = np.array([0.35, 0.0, 0.18])
        self.rotation = Rotation.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]])
        self.opening = OPEN_M
        self.closing = False
        self.slips_left = 0  # grasps that will fail
        self.block = _on_table(layout.block, BLOCK_HEIGHT_M / 2)
        self.container = _on_table(layout.container, 0.0)
        self.attached: Pose | None = None  # the block in the tool's frame
        self.pulses: list[Haptic] = []
        self._mapping, self._scale = mapping, scale
        self._velocity = np.zeros(6)
        self._smooth = np.zeros(6)
        self._pending: deque[Vector] = deque([np.zeros(6)] * max(1, round(lag_s * 120)))
        self._last: ControllerSample | None = None
        self._menu_ns: int | None = None
        self._fault = Haptic.FAULT

    def step(self, sample: ControllerSample) -> None:
        self._arm(sample)
        self._smooth = self._command(sample)
        self._pending.append(self._smooth)
        self._move(self._pending.popleft())
        self._fingers()
        self._last = sample

    def truth(self, now_ns: int) -> SceneTruth:
        tcp = Pose(self.position, self.rotation)
        return SceneTruth(now_ns, self.block, self.container, tcp, 0.0, self.opening)

    def placed(self) -> bool:
        offset = self.block.position - self.container.position
        return bool(np.abs(offset[:2]).max() < CONTAINER_INNER_M / 2) and self.attached is None

    def _arm(self, sample: ControllerSample) -> None:
        if sample.menu and self.arming in ("ready", "engaged", "holding"):
            held_on = self._last is not None and self._last.menu
            assert held_on, "the operator stopped an armed robot with the menu button"
        if not (sample.menu and self._last is not None and self._last.menu):
            self._menu_ns = sample.buttons_ns if sample.menu else None
        if self._menu_ns and sample.buttons_ns - self._menu_ns > NS_PER_S and sample.trigger == 0:
            self._menu_ns = None  # once for each press
            if self.arming == "disarmed":
                self.arming = "ready"
            elif self.arming == "fault":
                assert self._fault is Haptic.LINK_FAULT, "the operator cleared a fault alone"
                self.arming = "disarmed"
        squeezed = sample.trigger >= 0.6
        if self.arming == "ready" and squeezed:
            if self._last is not None and self._last.trigger < 0.6 and not self.held:
                self.arming = "engaged"
                self.engagements += 1
                self.pulses.append(Haptic.ENGAGE)
        elif self.arming == "engaged" and self.held:
            self.arming = "holding"
            self.pulses.append(Haptic.LIMIT)
        elif self.arming in ("engaged", "holding") and sample.trigger <= 0.4:
            self.arming = "ready"

    def fault(self, haptic: Haptic = Haptic.FAULT) -> None:
        self.arming = "fault"
        self._fault = haptic
        self.pulses.append(haptic)

    def _command(self, sample: ControllerSample) -> Vector:
        """Base-frame velocity asked for, shape (6,), smoothed."""
        if self._last is None:
            return np.zeros(6)
        if sample.grip >= 0.5 > self._last.grip:
            self.turning = not self.turning
            self.toggles += 1
        if sample.a and not self._last.a:
            self.closing = True
        if sample.b and not self._last.b:
            self.closing = False
            self._drop()
        if self.arming != "engaged" or sample.pose is None or self._last.pose is None:
            return np.zeros(6)
        if sample.pose_ns == self._last.pose_ns:
            return np.zeros(6)
        dt = (sample.pose_ns - self._last.pose_ns) / NS_PER_S
        linear = (sample.pose.position - self._last.pose.position) / dt
        angular = np.zeros(3)
        if self.turning:
            step = sample.pose.rotation * self._last.pose.rotation.inv()
            angular = self._mapping.apply(step.as_rotvec()) / dt
        mapped = np.concatenate((self._scale * self._mapping.apply(linear), angular))
        return self._smooth + (1 - math.exp(-dt / SMOOTHING_S)) * (mapped - self._smooth)

    def _move(self, command: Vector) -> None:
        dt = TICK_NS / NS_PER_S
        wished = command.copy()
        wished[slice(0, 3) if self.turning else slice(3, 6)] = 0.0
        if self.arming != "engaged" or self.deaf:
            wished[:] = 0.0
        floor_room = max(0.0, self.position[2] - 0.005)
        wished[2] = max(wished[2], -SPEED_M_S * floor_room / 0.03)
        for part, speed, acceleration in (
            (slice(0, 3), SPEED_M_S, ACCELERATION_M_S2),
            (slice(3, 6), TURN_RAD_S, ACCELERATION_RAD_S2),
        ):
            target = _limited(wished[part], speed)
            self._velocity[part] += _limited(target - self._velocity[part], acceleration * dt)
        self.position = self.position + self._velocity[:3] * dt
        if self._velocity[3:].any():
            self.rotation = Rotation.from_rotvec(self._velocity[3:] * dt) * self.rotation
        if self.attached is not None:
            self.block = Pose(
                self.position + self.rotation.apply(self.attached.position),
                self.rotation * self.attached.rotation,
            )

    def _fingers(self) -> None:
        step = FINGERS_M_S * TICK_NS / NS_PER_S
        if not self.closing:
            self.opening = min(OPEN_M, self.opening + step)
            return
        stop = 0.0 if self.attached is None and not self._between() else BLOCK_EDGE_M
        reached = self.opening > stop >= self.opening - step
        self.opening = max(stop, self.opening - step)
        if reached and stop > 0.0 and self.attached is None:
            if self.slips_left:
                self.slips_left -= 1
                self.opening = BLOCK_EDGE_M - 1e-6  # past the block: it slipped out
                return
            inverse = self.rotation.inv()
            self.attached = Pose(
                inverse.apply(self.block.position - self.position), inverse * self.block.rotation
            )

    def _between(self) -> bool:
        if self.opening < BLOCK_EDGE_M:
            return False
        gap = self.rotation.inv().apply(self.block.position - self.position)
        fingers = self.rotation.apply([0, 1, 0])
        faces = self.block.rotation.inv().apply(fingers)
        misaligned = math.degrees(math.acos(min(1.0, np.abs(faces[:2]).max())))
        return bool((np.abs(gap) < (0.005, 0.002, 0.006)).all()) and misaligned < 5

    def _drop(self) -> None:
        self.attached = None
        x, y, _ = self.block.position
        self.block = Pose(np.array([x, y, BLOCK_HEIGHT_M / 2]), self.block.rotation)


@dataclass
class Trial:
    """A robot, an operator and their controller, run in virtual time."""

    layout: Layout
    seed: int = 0
    lag_s: float = 0.05
    view_delay_s: float = 0.0
    misaligned: Rotation = field(default_factory=Rotation.identity)
    scale: float = 1.0
    confirms: bool = True
    now_ns: int = NS_PER_S

    def __post_init__(self) -> None:
        hand, config = HandConfig(), OperatorConfig()
        mapping = self.misaligned * Rotation.from_matrix(hand.rotation)
        self.robot = ToyRobot(self.layout, mapping, self.scale, self.lag_s)
        self._views: deque[SceneTruth] = deque()
        self.seen: SceneTruth | None = None
        self.showing = True  # False: the image stands still
        eyes = TruePerception(lambda: self.seen)
        traits = ParticipantProfile.scripted(config)
        operator = SimulatedOperator(hand, config, eyes, traits, self.seed, self.confirms)
        self.controller = VirtualController(operator, config, self.seed, _WIRING)
        self.controller.start()
        self.operator = operator

    def tick(self) -> ControllerSample:
        self.now_ns += TICK_NS
        self._views.append(self.robot.truth(self.now_ns))
        while self._views and self._views[0].t_ns <= self.now_ns - self.view_delay_s * NS_PER_S:
            view = self._views.popleft()
            self.seen = view if self.showing else self.seen
        sample = self.controller.sample(self.now_ns)
        self.robot.step(sample)
        for pulse in self.robot.pulses:
            self.controller.pulse(pulse)
        self.robot.pulses.clear()
        return sample

    def run(self, seconds: float) -> list[ControllerSample]:
        return [self.tick() for _ in range(round(seconds * 120))]

    def run_until(self, stage: Stage, seconds: float = 60.0) -> float:
        """Run until the operator is in `stage`; the time it took [s]."""
        start_ns = self.now_ns
        while self.operator.stage is not stage:
            self.tick()
            elapsed_s = (self.now_ns - start_ns) / NS_PER_S
            assert elapsed_s < seconds, f"{self.operator.stage} after {seconds} s"
        return (self.now_ns - start_ns) / NS_PER_S


def _on_table(place: Placement, height: float) -> Pose:
    return Pose(np.array([place.x, place.y, height]), Rotation.from_rotvec((0.0, 0.0, place.yaw)))


def _limited(vector: Vector, size: float) -> Vector:
    norm = math.sqrt(vector @ vector)
    return vector * (size / norm) if norm > size else vector

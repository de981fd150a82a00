"""A scripted hand that picks and places in a `World` along straight lines, for the tests."""

from __future__ import annotations

import math

import numpy as np

from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from hw.sim.layout import CONTAINER_INNER_M, Layout
from hw.sim.world.world import World
from tams_app.records import Vector
from tams_app.rotation import Rotation
from tams_app.vectors import floats

READY = np.radians([0, 36.81, 86.74, 0, 49.93, 0])
ARM = Lite6Model(offset_from_mm_deg((0, 0, 82, 0, 0, 0)))
CYCLE_NS = 4_000_000
GRASP_HEIGHT_M = 0.010
CARRY_HEIGHT_M = 0.12


class ScriptedPick:
    """Moves the world's arm; `collided` and `tracking_error_m` tell how the arm fared."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.collided = False
        self.tracking_error_m = 0.0
        self._joints = world.joints
        self._place = ARM.tcp_pose(self._joints).position
        self._yaw = 0.0
        self._drive: bool | None = False

    def move(self, place: Vector | list[float], yaw: float, speed: float = 0.15) -> None:
        """Straight to `place` [m] with `yaw` [rad], gripper down, smoothly."""
        start, start_yaw, end = self._place, self._yaw, np.asarray(place, float)
        way = max(float(np.linalg.norm(end - start)) / speed, abs(yaw - start_yaw))
        cycles = max(1, math.ceil(1.5 * way / 0.004))
        for cycle in range(1, cycles + 1):
            part = cycle / cycles
            part = part * part * (3 - 2 * part)
            self._step_to(start + (end - start) * part, start_yaw + (yaw - start_yaw) * part)
        self._place, self._yaw = end, yaw

    def grip(self, drive: bool | None, seconds: float = 0.4) -> None:
        self._drive = drive
        for _ in range(round(seconds / 0.004)):
            self._step_to(self._place, self._yaw)

    def pick(self, layout: Layout) -> None:
        block = layout.block
        self.grip(False, 0.05)
        self.move([block.x, block.y, 0.08], block.yaw)
        self.move([block.x, block.y, GRASP_HEIGHT_M], block.yaw, 0.08)
        self.grip(True)
        self.move([block.x, block.y, CARRY_HEIGHT_M], block.yaw)

    def place(self, layout: Layout) -> None:
        container = layout.container
        self.move([container.x, container.y, CARRY_HEIGHT_M], 0.0, 0.25)
        self.move([container.x, container.y, 0.04], 0.0)
        self.grip(False)
        self.move([container.x, container.y, CARRY_HEIGHT_M], 0.0)

    def block_height(self) -> float:
        return float(self.world.truth(0).block.position[2])

    def block_in_container(self) -> bool:
        truth = self.world.truth(0)
        inside = truth.container.rotation.inv().apply(
            truth.block.position - truth.container.position
        )
        return bool(np.abs(inside[:2]).max() < CONTAINER_INNER_M / 2 and inside[2] < 0.03)

    def _step_to(self, place: Vector, yaw: float) -> None:
        rotation = Rotation.from_rotvec((0.0, 0.0, yaw)) * Rotation.from_rotvec((math.pi, 0.0, 0.0))
        joints = ARM.approach(floats(place), rotation.as_matrix(), self._joints, max_steps=60)
        assert joints is not None
        self._joints = joints
        state = self.world.step(joints, self._drive, CYCLE_NS)
        reached = ARM.tcp_pose(state.joints).position
        self.tracking_error_m = max(self.tracking_error_m, float(np.linalg.norm(reached - place)))
        self.collided |= state.collision

"""Arm, controller box and world in this process, under the caller's clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw.arms import arm_kind
from hw.boundary import session_boundary
from hw.sim.layout import draw_layout
from hw.sim.world.world import World
from tams_app.config import Config
from tams_app.records import SceneTruth, Vector
from tams_app.runtime.clock import Clock
from tams_app.session import build
from tams_app.session.arm_gate import ArmGate


class VirtualRobot:
    """The simulated rig's scene of `config.seed` with the arm at its ready pose. One thread."""

    def __init__(self, config: Config, clock: Clock, note: Callable[[str, str], None]) -> None:
        joints = np.radians(np.array(config.arm.ready_joints_deg))
        boundary = session_boundary(config.arm, config.limits)
        self.layout = draw_layout(config.seed)
        self._world = World(self.layout, joints)
        kind = arm_kind(config.arm.model)
        self.arm = kind.simulate(config.arm, clock, joints, boundary, self._world)
        self.gate = ArmGate(self.arm, build.servo(config), boundary, note)

    def catch_up(self) -> int:
        """Bring arm and world up to the clock; the instant [ns] that they stand at then."""
        self.arm.state()
        return self.arm.simulated_ns

    @property
    def qpos(self) -> Vector:
        """All that a renderer needs to draw the world, shape (nq,)."""
        return self._world.qpos

    def truth(self) -> SceneTruth:
        """Where things really are now: for the trial's rules, never for the operator."""
        return self._world.truth(self.catch_up())

    def gripper_closed(self) -> bool | None:
        """The last command to the gripper, as the arm reports it."""
        state = self.arm.state()
        return state.gripper_closed if state is not None else None

    def stop(self) -> None:
        """Stop the arm for good."""
        self.gate.stop()

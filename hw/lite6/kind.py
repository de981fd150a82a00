"""The Lite 6 as a kind of arm: what `arm.model: lite6` stands for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hw.arm import Arm, ArmKind, ArmKinematics, FoundArm, SimulatedArm, TcpBoundary
from hw.lite6.commands import LIMITS
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig
from tams_app.records import Vector
from tams_app.runtime.clock import Clock

if TYPE_CHECKING:
    from hw.sim.controller.plant import Plant


class Lite6Kind(ArmKind):
    """UFACTORY's Lite 6; the SDK and the simulation are loaded when they are asked for."""

    title = "Lite 6"
    limits = LIMITS
    stop_channel = "hw.lite6.stop_channel:StopChannel"
    rig = "hw.sim.rig"

    def make_arm(
        self,
        config: ArmConfig,
        clock: Clock,
        control_rate_hz: float,
        boundary: TcpBoundary | None,
    ) -> Arm:
        from hw.lite6.arm import Lite6

        return Lite6(config, clock, control_rate_hz, boundary)

    def kinematics(self, config: ArmConfig) -> ArmKinematics:
        return Lite6Model(offset_from_mm_deg(config.tcp_offset_mm_deg))

    def simulate(
        self,
        config: ArmConfig,
        clock: Clock,
        joints: Vector,
        boundary: TcpBoundary | None,
        plant: Plant | None = None,
        gripper_closed: bool | None = None,
    ) -> SimulatedArm:
        from hw.sim.controller.inprocess_arm import InProcessArm
        from hw.sim.controller.model import ControllerModel
        from hw.sim.controller.plant import IdealPlant
        from hw.sim.controller.settings import outputs_for

        model = ControllerModel(plant or IdealPlant(), joints)
        model.settings.tool_outputs = outputs_for(gripper_closed)
        return InProcessArm(config, clock, model, boundary)

    def find(self, config: ArmConfig) -> FoundArm:
        from hw.lite6.discovery import find_arm

        return find_arm(config)


KIND = Lite6Kind()

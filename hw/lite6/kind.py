"""The Lite 6 as a kind of arm: what `arm.model: lite6` stands for."""

from __future__ import annotations

from hw.arm import Arm, ArmKind, FoundArm, TcpBoundary
from hw.lite6.commands import LIMITS
from hw.lite6.figure import Lite6Figure
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig
from tams_app.records import ArmFigure, ArmKinematics
from tams_app.runtime.clock import Clock


class Lite6Kind(ArmKind):
    """UFACTORY's Lite 6; the SDK is loaded when it is asked for."""

    title = "Lite 6"
    limits = LIMITS
    stop_channel = "hw.lite6.stop_channel:Lite6StopChannel"
    report_watch = "hw.lite6.report_watch:Lite6ReportWatch"
    simulation = "hw.sim.controller.inprocess_arm:simulated_lite6"
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

    def figure(self) -> ArmFigure:
        return Lite6Figure()

    def find(self, config: ArmConfig) -> FoundArm:
        from hw.lite6.discovery import find_arm

        return find_arm(config)


KIND = Lite6Kind()

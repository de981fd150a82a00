"""The Lite 6 as a kind of arm: what `arm.model: lite6` stands for.

Its figure, in few solids, is measured from our own scene, `hw/sim/world/rig.xml`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hw.arm import Arm, ArmKind, FoundArm, TcpBoundary
from hw.lite6.commands import LIMITS
from hw.lite6.kinematics import Lite6Model, links, offset_from_mm_deg
from tams_app.config import ArmConfig
from tams_app.records import ArmFigure, ArmKinematics, Pose, Solid, SolidKind, Vector
from tams_app.rotation import Rotation
from tams_app.runtime.clock import Clock
from tams_app.vectors import Floats3

_SHELL = (0.88, 0.88, 0.89)
_JOINT = (0.30, 0.31, 0.34)
_PAD = (0.16, 0.78, 0.28)


def _rod(start: Floats3, end: Floats3, radius: float, colour: Floats3 = _SHELL) -> Solid:
    """A cylinder between two points of the link's frame [m]."""
    way = np.subtract(end, start)
    length = float(np.linalg.norm(way))
    axis = np.cross((0.0, 0.0, 1.0), way / length)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, way[2] / length))
    turn = Rotation.from_rotvec(axis * (angle / sine)) if sine else Rotation.identity()
    middle = np.add(start, end) / 2.0
    return Solid(SolidKind.CYLINDER, Pose(middle, turn), (2 * radius, 2 * radius, length), colour)


def _box(middle: Floats3, half: Floats3, colour: Floats3 = _JOINT) -> Solid:
    extent = (2 * half[0], 2 * half[1], 2 * half[2])
    return Solid(SolidKind.BOX, Pose(np.array(middle), Rotation.identity()), extent, colour)


_SOLIDS = {
    "base": (
        _rod((0, 0, 0), (0, 0, 0.020), 0.068, _JOINT),
        _rod((0, 0, 0.020), (0, 0, 0.124), 0.062),
        _rod((0, 0, 0.124), (0, 0, 0.168), 0.055, _JOINT),
    ),
    "link1": (
        _rod((0, 0, -0.075), (0, 0, -0.010), 0.050),
        _rod((0, -0.030, 0), (0, 0.050, 0), 0.046),
        _rod((0, -0.079, 0), (0, -0.030, 0), 0.047, _JOINT),
    ),
    "link2": (
        _rod((0, 0, 0.088), (0.200, 0, 0.088), 0.037),
        _rod((0, 0, 0.040), (0, 0, 0.122), 0.046),
        _rod((0, 0, 0.122), (0, 0, 0.132), 0.044, _JOINT),
        _rod((0.200, 0, 0.046), (0.200, 0, 0.122), 0.043),
        _rod((0.200, 0, 0.122), (0.200, 0, 0.131), 0.041, _JOINT),
    ),
    "link3": (
        _rod((0, 0, -0.046), (0, 0, 0.034), 0.042),
        _rod((0, 0, 0.034), (0, 0, 0.041), 0.040, _JOINT),
        _rod((0, 0, 0), (0.087, 0, 0), 0.036),
        _rod((0.087, 0, 0), (0.087, -0.060, 0), 0.036),
    ),
    "link4": (
        _rod((0, 0, -0.168), (0, 0, -0.160), 0.036, _JOINT),
        _rod((0, 0, -0.160), (0, 0, -0.045), 0.035),
        _rod((0, 0, -0.045), (0, -0.012, -0.010), 0.034),
        _rod((0, -0.030, 0), (0, 0.022, 0), 0.034, _JOINT),
    ),
    "link5": (
        _rod((0, -0.010, 0), (0, 0.010, 0), 0.033),
        _rod((0, 0.008, 0), (0, 0.034, 0), 0.034),
    ),
    "link6": (
        _rod((0, 0, -0.026), (0, 0, -0.003), 0.032, _JOINT),
        _rod((0, 0, -0.003), (0, 0, 0), 0.031),
        # the gripper; its fingers stand still, open, as nothing senses them
        _box((0, 0, 0.027), (0.018, 0.034, 0.021)),
        _box((0, 0, 0.050), (0.0125, 0.032, 0.003)),
        *(
            _box((x, side * y, z), half, colour)
            for side in (-1, 1)
            for (x, y, z), half, colour in (
                ((0, 0.015, 0.061), (0.0055, 0.0030, 0.009), _JOINT),
                ((0, 0.012, 0.075), (0.0065, 0.0040, 0.011), _PAD),
                ((0, 0.0152, 0.075), (0.0068, 0.0012, 0.006), _JOINT),
            )
        ),
    ),
}
# Where closed fingers are, and up to 10 mm beyond their tips what they hold.
_GRIP = (_box((0, 0, 0.074), (0.0085, 0.0165, 0.022)),)


class Lite6Figure:
    """The Lite 6 with its gripper; it satisfies `ArmFigure`."""

    flange = "link6"
    solids: Mapping[str, tuple[Solid, ...]] = _SOLIDS
    grip: tuple[Solid, ...] = _GRIP

    def place(self, joints: Vector) -> Mapping[str, Pose]:
        """The links' frames in the base frame, for `joints` [rad], shape (6,)."""
        return {
            f"link{number}": Pose(np.array(at), Rotation.from_matrix(np.array((x, y, z)).T))
            for number, (x, y, z, at) in enumerate(links(joints), start=1)
        }


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

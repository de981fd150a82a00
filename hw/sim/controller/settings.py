"""What can be configured in the controller, with the defaults of a fresh Lite 6."""

from __future__ import annotations

from dataclasses import dataclass

from hw.arm import GripperDrive, TcpBoundary

_WIDEST = TcpBoundary((-9999, -9999, -9999), (9999, 9999, 9999))
_DRIVES = {0b01: GripperDrive.OPEN, 0b10: GripperDrive.CLOSE}  # of the first two tool outputs


@dataclass(slots=True)
class ControllerSettings:
    """Registers that keep what was written to them, in the units of the wire (mm, rad, kg)."""

    tcp_offset: tuple[float, ...] = (0.0,) * 6  # x, y, z [mm], roll, pitch, yaw [rad]
    load: tuple[float, ...] = (0.0,) * 4  # mass [kg], centre of gravity [mm]
    collision_sensitivity: int = 3  # 0 is off
    fence: bool = False
    boundary: TcpBoundary = _WIDEST
    self_collision_check: bool = True
    simulation_robot: bool = False  # only pretends to move; the model reports it, no more
    tool_outputs: int = 0  # bit n is tool output n

    @property
    def gripper(self) -> GripperDrive:
        """What the tool outputs drive the gripper to; both at once do nothing."""
        return _DRIVES.get(self.tool_outputs & 0b11, GripperDrive.OFF)


def outputs_for(closed: bool | None) -> int:
    """The tool outputs that drive the gripper closed or open; None: neither."""
    drive = {None: GripperDrive.OFF, True: GripperDrive.CLOSE, False: GripperDrive.OPEN}[closed]
    return next((outputs for outputs, driven in _DRIVES.items() if driven is drive), 0)

"""What can be configured in the controller, with the defaults of a fresh Lite 6."""

from __future__ import annotations

from dataclasses import dataclass

from hw.arm import TcpBoundary

_WIDEST = TcpBoundary((-9999, -9999, -9999), (9999, 9999, 9999))
_OPEN, _CLOSE = 0b01, 0b10  # the first two tool outputs


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
    def closing(self) -> bool | None:
        """Whether the outputs drive the gripper closed or open; None: neither, or both at once."""
        return {_OPEN: False, _CLOSE: True}.get(self.tool_outputs & (_OPEN | _CLOSE))


def outputs_for(closed: bool | None) -> int:
    """The tool outputs that drive the gripper closed or open; None: neither."""
    return 0 if closed is None else _CLOSE if closed else _OPEN

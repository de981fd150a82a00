"""Settings of the Lite 6's controller: those that TAMS makes, and what of it TAMS refuses.

The control box keeps what UFACTORY Studio sets (its manual, chapter 6), and moves by that whatever
program commands it.
"""

from __future__ import annotations

import math
from typing import Any

from hw.arm import TcpBoundary
from hw.lite6.commands import boundary_edges
from hw.lite6.protocol import AXES, LITE6_TYPE, Code, return_code_sentence
from hw.lite6.report import StatusReport
from hw.lite6.sdk import set_collision_sensitivity
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError

MIN_FIRMWARE = (1, 8, 0)  # older ones drop `duration`, the controller's own deadman
_TOLERANCE = 1e-3  # mm, rad, kg
_UPRIGHT = (0.0, 0.0, -1.0)  # gravity in the base frame of an arm on a table
_LEVEL = 0.02  # about a degree
_LOAD = "load"


def accept(code: int, call: str, but: Code = Code.OK) -> None:
    """DeviceError unless by the SDK's return code `call` was done, or the code is `but`."""
    if code not in (Code.OK, Code.WARNING, but):
        raise DeviceError(return_code_sentence(code, call))


class Lite6Settings:
    """Tool, sensitivity and boundary that TAMS sets in one connected controller."""

    def __init__(self, api: Any, config: ArmConfig, boundary: TcpBoundary | None) -> None:
        self._api, self._config, self._boundary = api, config, boundary
        self.load_is_set = False

    def set_boundary(self) -> None:
        """Also in an error, which the reply reports and which is judged elsewhere; or DeviceError.

        Set first: outside of an older boundary the controller may not let go of its error.
        """
        if self._boundary is None:
            return
        edges = self._api.set_reduced_tcp_boundary(boundary_edges(self._boundary))
        accept(edges, "the safety boundary", but=Code.ERROR)
        switched = self._api.set_fence_mode(True)  # a list, but a number if not connected
        code = switched[0] if isinstance(switched, list) else switched
        accept(code, "the safety boundary's switch", but=Code.ERROR)

    def set(self) -> None:
        """All but boundary and load, on connecting; DeviceError if the controller refuses.

        Collision sensitivity and TCP offset move the controller's state: never later than this.
        """
        config = self._config
        accept(set_collision_sensitivity(self._api, config.collision_sensitivity), "sensitivity")
        accept(self._api.set_self_collision_detection(True), "the self-collision check")
        offset = list(config.tcp_offset_mm_deg)
        accept(self._api.set_tcp_offset(offset, is_radian=False, wait=False), "the TCP offset")
        self.load_is_set = False

    def set_load(self) -> None:
        """The controller queues the load like a motion: it takes it only when ready."""
        centre = list(self._config.tcp_load_centre_mm)
        accept(self._api.set_tcp_load(self._config.tcp_load_kg, centre), "the load")
        self.load_is_set = True

    def missing(self, status: StatusReport) -> str:
        """Those that a report shows otherwise: a wrong TCP would move the wrong point."""
        names = other_settings(self._config, self._boundary, status)
        return ", ".join(name for name in names if name != _LOAD or self.load_is_set)

    def problem(self, status: StatusReport) -> str:
        """Why an arm that was set up must not move by this report; "" if it may."""
        if missing := self.missing(status):
            return (
                f"The arm's {missing} is not what TAMS had set; close other programs that use it, "
                "then confirm, which sets it again."
            )
        return foreign_refusal(status)


def other_settings(
    config: ArmConfig, boundary: TcpBoundary | None, status: StatusReport
) -> list[str]:
    """Names of what TAMS sets and the controller has otherwise."""
    wanted_mm, wanted_deg = config.tcp_offset_mm_deg[:3], config.tcp_offset_mm_deg[3:]
    turns = _turns(status.tcp_offset[3:], wanted_deg)
    load = (config.tcp_load_kg, *config.tcp_load_centre_mm)
    edges = None if boundary is None else tuple(boundary_edges(boundary))
    held = {
        "TCP offset": _close((*status.tcp_offset[:3], *turns), (*wanted_mm, 0.0, 0.0, 0.0)),
        _LOAD: _close(status.load, load),
        "collision sensitivity": status.collision_sensitivity == config.collision_sensitivity,
        "self-collision check": status.self_collision_check,
        "safety boundary": edges is None or status.boundary == edges,
    }
    return [name for name, is_held in held.items() if not is_held]


def foreign_refusal(status: StatusReport) -> str:
    """Why TAMS does not move an arm set up like this, and what to change; "" if it does.

    Refused is what makes it move otherwise than commanded, or weakens what protects from it. Its
    other settings do not matter here (sensitivity of manual mode, jerk of planned moves), or are
    set on connecting.
    """
    slow = "" if status.reduced is None else f"{status.reduced[0]:g} mm/s"
    tilted = not _close(status.gravity, _UPRIGHT, _LEVEL)
    displaced = not _close(status.world_offset, (0.0,) * 6)
    judged = (
        (status.simulated, "only pretends to move", "switch its simulation mode off"),
        (
            slow,
            f"is in reduced mode, at most {slow}",
            "set limits.max_speed_mm_s instead, and switch reduced mode off",
        ),
        (status.rebound, "would move back after a collision", "switch collision rebound off"),
        (status.approximate, "leaves its path near singularities", "switch approximation off"),
        (tilted, "counts as mounted at an angle", "mount it upright and set that"),
        (displaced, "has base coordinates with an offset", "set that offset to zero"),
    )
    return " ".join(
        f"The arm {what}; {remedy} in UFACTORY Studio."
        for applies, what, remedy in judged
        if applies
    )


def _close(
    values: tuple[float, ...], wanted: tuple[float, ...], tolerance: float = _TOLERANCE
) -> bool:
    return all(abs(a - b) <= tolerance for a, b in zip(values, wanted, strict=True))


def _turns(angles_rad: tuple[float, ...], wanted_deg: tuple[float, ...]) -> tuple[float, ...]:
    """Differences [rad] without whole turns."""
    return tuple(
        math.remainder(angle - math.radians(wanted), math.tau)
        for angle, wanted in zip(angles_rad, wanted_deg, strict=True)
    )


def unfitness(axes: int, device_type: int, firmware: tuple[int, ...]) -> str:
    """The reason why TAMS cannot use this arm, in one sentence; "" if it can."""
    if (axes, device_type) != (AXES, LITE6_TYPE):
        return (
            f"The arm is no Lite 6 (axes {axes}, type {device_type}); set arm.host to the Lite 6."
        )
    if firmware < MIN_FIRMWARE:
        return (
            f"The arm's firmware {dotted(firmware)} is older than {dotted(MIN_FIRMWARE)} and "
            "would not stop by itself when commands cease; update it with UFACTORY Studio."
        )
    return ""


def dotted(firmware: tuple[int, ...]) -> str:
    """A version as it is written."""
    return ".".join(map(str, firmware))

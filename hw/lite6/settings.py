"""TAMS's settings of the Lite 6's controller, and a check that the controller holds them."""

from __future__ import annotations

import math
from typing import Any

from hw.arm import TcpBoundary
from hw.lite6.codes import Code, return_code_sentence
from hw.lite6.commands import boundary_edges
from hw.lite6.report import StatusReport
from hw.lite6.sdk import set_collision_sensitivity
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError

_TOLERANCE = 1e-3  # mm, rad, kg


def accept(code: int, call: str, but: Code = Code.OK) -> None:
    """DeviceError unless the SDK's return code says that `call` was done, or is `but`."""
    if code not in (Code.OK, Code.WARNING, but):
        raise DeviceError(return_code_sentence(code, call))


class Lite6Settings:
    """Tool, sensitivity and boundary of one connected controller."""

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
        self.check_boundary()

    def set_load(self) -> None:
        """The controller queues the load like a motion: it takes it only when ready."""
        centre = list(self._config.tcp_load_centre_mm)
        accept(self._api.set_tcp_load(self._config.tcp_load_kg, centre), "the load")
        self.load_is_set = True

    def check_boundary(self) -> None:
        """DeviceError unless the controller holds the boundary, which no report contains."""
        if self._boundary is None:
            return
        code, states = self._api.get_reduced_states()
        accept(code, "reading the safety boundary")
        edges, fence = list(states[1]), states[5]
        if edges != boundary_edges(self._boundary) or not fence:
            raise DeviceError(
                "The arm did not take its safety boundary; restart its control box, and arm again."
            )

    def are_in(self, status: StatusReport) -> bool:
        """True if a report shows them: a wrong TCP would move the wrong point."""
        config = self._config
        wanted_mm, wanted_deg = config.tcp_offset_mm_deg[:3], config.tcp_offset_mm_deg[3:]
        load = (config.tcp_load_kg, *config.tcp_load_centre_mm)
        return (
            _close(status.tcp_offset[:3], wanted_mm)
            and _close(_turns(status.tcp_offset[3:], wanted_deg), (0.0, 0.0, 0.0))
            and status.collision_sensitivity == config.collision_sensitivity
            and (not self.load_is_set or _close(status.load, load))
        )


def _close(values: tuple[float, ...], wanted: tuple[float, ...]) -> bool:
    return all(abs(a - b) <= _TOLERANCE for a, b in zip(values, wanted, strict=True))


def _turns(angles_rad: tuple[float, ...], wanted_deg: tuple[float, ...]) -> tuple[float, ...]:
    """Differences [rad] without whole turns."""
    return tuple(
        math.remainder(angle - math.radians(wanted), math.tau)
        for angle, wanted in zip(angles_rad, wanted_deg, strict=True)
    )

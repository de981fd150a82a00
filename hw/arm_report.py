"""What an arm reports of its motion, as the guard process reads it; light, without numpy."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class ArmReport(NamedTuple):
    """Where the arm is, after its own controller."""

    position: tuple[float, float, float]  # of the TCP in the base frame [m]
    joints: tuple[float, ...]  # [rad]


class ReportWatch(Protocol):
    """A connection of its own that reads nothing but the arm's reports, for the guard process.

    Made with host and report port.
    """

    def start(self) -> None:
        """Connect; DeviceError if the arm sends no reports there."""

    def newest(self, now_ns: int) -> ArmReport | None:
        """The newest report that came since the last call, None if there is none.

        Does not block; a connection that is gone or silent is made anew. Numbers are finite.
        """

    def close(self) -> None:
        """Disconnect; may be called twice."""

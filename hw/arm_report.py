"""An arm's motion reports as the guard process reads them; light, without numpy."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class ArmReport(NamedTuple):
    """What an arm's own controller reports: the TCP in the base frame [m], six joints [rad]."""

    position: tuple[float, float, float]
    joints: tuple[float, ...]


class ReportWatch(Protocol):
    """A connection of its own that reads nothing but the arm's reports, for the guard process.

    It is made with host and report port.
    """

    def start(self) -> None:
        """Connect.

        Raises:
            DeviceError: the arm sends no reports there.
        """

    def newest(self, now_ns: int) -> ArmReport | None:
        """The newest report that came since the last call; does not block.

        A connection that is gone or silent is made anew.

        Args:
            now_ns: the time [ns], CLOCK_MONOTONIC.

        Returns:
            The report, its numbers finite; None if there was none.
        """

    def close(self) -> None:
        """Disconnect; may be called twice."""

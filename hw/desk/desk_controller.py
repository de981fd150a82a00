"""A device on a desk as a controller; what it reads is a deflection, what it gives is a hand."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hw.controller import Controller
from hw.desk.virtual_hand import NEUTRAL, Deflection, VirtualHand
from tams_app.config import DeskConfig
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.units import NS_PER_MS
from tams_app.vectors import Floats3

SILENT_NS = 100 * NS_PER_MS  # what is deflected reports far more often
_NOTHING = ControllerSample(
    ControllerStatus.DISCONNECTED, None, 0, 0, trigger=0.0, grip=0.0, a=False, b=False, menu=False
)


@dataclass(frozen=True, slots=True)
class Reading:
    """The state in which a device is known to be until `known_ns`, not the time of the reading.

    Without OK nothing is pressed.
    """

    status: ControllerStatus
    known_ns: int
    deflection: Deflection = NEUTRAL


class DeskController(Controller):
    """A device that reports nothing is a hand whose pose and buttons freeze.

    A hand that rests is no frozen pose: while the device is heard of, the pose is as new as the
    tick.
    """

    late_ns = 0  # so much later than it was known a reading may come, and counts as new

    def __init__(self, config: DeskConfig, rotation: tuple[Floats3, Floats3, Floats3]) -> None:
        self._config, self._rotation = config, rotation
        self._hand = VirtualHand(config, rotation)
        self._pose: Pose | None = None
        self._pose_ns = self._buttons_ns = 0

    @abstractmethod
    def reading(self) -> Reading | None:
        """The newest one; None before the start and after the end."""

    def sample(self, now_ns: int) -> ControllerSample:
        reading = self.reading()
        if reading is None:
            self._pose_ns = self._buttons_ns = 0
            return _NOTHING
        if reading.status is not ControllerStatus.OK:
            return self._missing(reading.status)
        self._buttons_ns = max(self._buttons_ns, min(now_ns, reading.known_ns + self.late_ns))
        asked = reading.deflection
        if now_ns - reading.known_ns <= SILENT_NS + self.late_ns or self._pose is None:
            self._pose = self._hand.step(now_ns, asked)
            self._pose_ns = now_ns
        return ControllerSample(
            ControllerStatus.OK,
            self._pose,
            self._pose_ns,
            self._buttons_ns,
            trigger=asked.trigger,
            grip=float(asked.grip),
            a=asked.a,
            b=asked.b,
            menu=asked.menu,
            presses=asked.presses,
        )

    def _missing(self, status: ControllerStatus) -> ControllerSample:
        self._hand = VirtualHand(self._config, self._rotation)
        self._pose = None
        return ControllerSample(
            status,
            None,
            self._pose_ns,
            self._buttons_ns,
            trigger=0.0,
            grip=0.0,
            a=False,
            b=False,
            menu=False,
        )

    def pulse(self, haptic: Haptic) -> None:
        """It cannot be felt."""

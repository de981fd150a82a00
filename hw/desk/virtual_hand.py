"""What held keys ask for, as the motion of a hand."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tams_app.config import DeskConfig
from tams_app.records import Pose, Presses
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import ZERO, Floats3, plus_times, shortened, times, towards

_LONGEST_GAP_NS = 50 * NS_PER_MS  # what was asked for in a longer one is not made up for


@dataclass(frozen=True, slots=True)
class Deflection:
    """How far each axis is deflected, -1 to 1, in the arm's base frame, and what is pressed.

    linear: forward, left, up. angular: turns about the same axes, right-handed. The buttons are
    those of `ControllerSample`.
    """

    linear: Floats3 = ZERO
    angular: Floats3 = ZERO
    trigger: float = 0.0
    grip: bool = False
    a: bool = False
    b: bool = False
    presses: Presses = field(default_factory=Presses)


RAMP_S = 0.25  # from rest to full speed: soon enough for a tap, and no jump


@dataclass(slots=True)
class VirtualHand:
    """A hand that moves as fast as the axes are deflected; pure.

    It reaches the speed asked for within `RAMP_S` and stands still as soon as the
    deadman is let go. `rotation` takes the tracking frame to the arm's base frame
    (`HandConfig.rotation`): the hand's pose is in the tracking frame, as that of any controller.
    """

    config: DeskConfig
    rotation: tuple[Floats3, Floats3, Floats3]
    _position: Floats3 = ZERO
    _turn: Rotation = field(default_factory=Rotation.identity)
    _linear: Floats3 = ZERO
    _angular: Floats3 = ZERO
    _last_ns: int | None = None

    def step(self, now_ns: int, asked: Deflection) -> Pose:
        """The pose at `now_ns`."""
        gap_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        if asked.trigger <= 0.0 or not 0 < gap_ns <= _LONGEST_GAP_NS:
            self._linear = self._angular = ZERO
        else:
            self._go(gap_ns / NS_PER_S, asked)
        return Pose(np.array(self._position), self._turn)

    def _go(self, interval_s: float, asked: Deflection) -> None:
        config = self.config
        change = interval_s / RAMP_S
        # two axes at once are no faster than one
        for_linear = times(shortened(asked.linear, 1.0), config.speed_m_s)
        for_angular = times(shortened(asked.angular, 1.0), config.turn_rad_s)
        self._linear = towards(self._linear, for_linear, config.speed_m_s * change)
        self._angular = towards(self._angular, for_angular, config.turn_rad_s * change)
        way = self._in_tracking_frame(times(self._linear, interval_s))
        turn = self._in_tracking_frame(times(self._angular, interval_s))
        self._position = plus_times(self._position, way, 1.0)
        self._turn = self._turn.turned(turn)

    def _in_tracking_frame(self, vector: Floats3) -> Floats3:
        """The rotation's transpose, applied."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self.rotation
        x, y, z = vector
        return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z

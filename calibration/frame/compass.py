"""Which of the robot's directions the hand moves in: the product's own mapping, and no arm."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from calibration.frame.prompts import SIX_WAYS, Move
from tams_app.config import Config, HandConfig
from tams_app.records import ControllerSample
from tams_app.teleop.motion import HandMotion

MIN_SPEED_M_S = 0.04  # of the hand: slower, no direction is lit
MAX_OFF_AXIS_DEG = 30.0


class Compass:
    """Lights the direction that teleoperation would send the arm in."""

    def __init__(self, config: Config, hand: HandConfig) -> None:
        """`hand`: the mapping to be tried."""
        self._motion = HandMotion(hand, config.freshness.pose_frozen_ms * 1e6)
        self._scale = hand.translation_scale
        self._last_ns: int | None = None
        self.lit: Move | None = None
        self._seen: Counter[Move] = Counter()

    def update(self, sample: ControllerSample, now_ns: int, held: bool) -> Move | None:
        """The direction that is lit now; those lit while the trigger is `held` are counted."""
        if self._last_ns is None:
            self._motion.anchor(sample)
            self._last_ns = now_ns
        interval_s = (now_ns - self._last_ns) / 1e9
        self._last_ns = now_ns
        twist = self._motion.update(sample, now_ns, interval_s)
        self.lit = direction_of(twist.linear / self._scale)
        if held and self.lit is not None:
            self._seen[self.lit] += 1
        return self.lit

    def mostly(self) -> Move | None:
        """The direction that was lit longest since this was last asked."""
        most = self._seen.most_common(1)
        self._seen.clear()
        return most[0][0] if most else None


def direction_of(velocity: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Move | None:
    """The robot's axis that a velocity [m/s] goes along within 30°, None for none."""
    speed = float(np.linalg.norm(velocity))
    if speed < MIN_SPEED_M_S:
        return None
    best = max(SIX_WAYS, key=lambda way: float(way.direction @ velocity))
    share = float(best.direction @ velocity) / speed
    return best if share >= math.cos(math.radians(MAX_OFF_AXIS_DEG)) else None

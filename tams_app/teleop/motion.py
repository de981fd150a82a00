"""From the hand's poses to the twist it asks for (paper, section II-A)."""

from __future__ import annotations

import math

from tams_app.config import HandConfig
from tams_app.records import ControllerSample, Pose, Twist
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import ZERO, Floats3, dot, floats, minus, norm, plus_times, times

_MIN_INTERVAL_S = 0.002  # two poses closer than this are one with jitter
_LONGEST_GAP_NS = 50 * NS_PER_MS
SMOOTHING_S = 0.04  # time constant of the low-pass: below what a tracked hand trembles at
# Bands of the hand's speed: what no hand reaches at work counts as that fast, and what none
# reaches at all is an error of tracking.
CLAMP_ABOVE_M_S, REJECT_ABOVE_M_S = 1.5, 4.0
CLAMP_ABOVE_RAD_S, REJECT_ABOVE_RAD_S = 6.0, 15.0
MAX_REJECTS = 6  # poses in a row that are a fault
# How far the arm may be led from the hand by late poses, within about a second.
MAX_DRIFT_MM, MAX_DRIFT_DEG = 25.0, 4.0
_FORGETS_S = 1.0  # time constant of that drift


class HandMotion:
    """Velocities from successive poses, three bands against impossible speeds, EMA, mapping.

    v = Δp/Δt and ω = log(R_t R_{t-1}ᵀ)/Δt over the times at which the pose changed. An unchanged
    pose keeps the velocity for `hold_ns`, then it is zero; after more than 50 ms the next pose is
    where the hand begins anew, so that nothing of a gap is made up for. Up to the clamp speed a
    velocity passes, up to the reject speed it is shortened, beyond it is left out as if the pose
    had not changed.
    """

    def __init__(
        self,
        config: HandConfig,
        hold_ns: float,
        fastest: tuple[float, float] = (math.inf, math.inf),
    ) -> None:
        """`fastest`: the arm at its fastest [m/s, rad/s]."""
        self._config = config
        linear, angular = config.translation_scale, config.rotation_scale
        self._linear_drift = Drift(fastest[0] / linear, MAX_DRIFT_MM / 1000.0 / linear)
        most_rad = math.radians(MAX_DRIFT_DEG)
        self._angular_drift = Drift(fastest[1] / angular, most_rad / angular)
        self._hold_ns = hold_ns
        self._rotation: tuple[Floats3, Floats3, Floats3] = config.rotation
        self._last: Pose | None = None
        self._last_ns = 0
        self._accepted_ns = 0
        self._linear = ZERO
        self._angular = ZERO
        self._smooth_linear = ZERO
        self._smooth_angular = ZERO
        self.rejects = 0  # in a row

    @property
    def impossible(self) -> bool:
        """Whether too many poses in a row were too far from the one before."""
        return self.rejects >= MAX_REJECTS

    def is_adrift(self, turning: bool) -> bool:
        """Whether the arm was asked for too much, or too little, of what the hand did of late."""
        return (self._angular_drift if turning else self._linear_drift).is_too_large

    def anchor(self, sample: ControllerSample) -> None:
        """Start anew from this pose: nothing of what the hand did before counts."""
        self._last, self._last_ns = sample.pose, sample.pose_ns
        self._accepted_ns = sample.pose_ns
        self._linear = self._angular = ZERO
        self._smooth_linear = self._smooth_angular = ZERO
        self._linear_drift.clear()
        self._angular_drift.clear()
        self.rejects = 0

    def update(self, sample: ControllerSample, now_ns: int, interval_s: float) -> Twist:
        """The smoothed, mapped twist in the arm's base frame, `interval_s` after the last tick."""
        self._linear_drift.used(self._linear, interval_s)
        self._angular_drift.used(self._angular, interval_s)
        if sample.pose is not None and sample.pose_ns > self._last_ns:
            self._take(sample.pose, sample.pose_ns)
        if now_ns - self._accepted_ns > self._hold_ns:
            self._linear = self._angular = ZERO
        alpha = 1.0 - math.exp(-max(0.0, interval_s) / SMOOTHING_S)
        self._smooth_linear = _approach(self._smooth_linear, self._linear, alpha)
        self._smooth_angular = _approach(self._smooth_angular, self._angular, alpha)
        return Twist(
            times(self._mapped(self._smooth_linear), self._config.translation_scale),
            times(self._mapped(self._smooth_angular), self._config.rotation_scale),
        )

    def _mapped(self, vector: Floats3) -> Floats3:
        x, y, z = self._rotation
        return dot(x, vector), dot(y, vector), dot(z, vector)

    def _take(self, pose: Pose, pose_ns: int) -> None:
        last, last_ns = self._last, self._last_ns
        self._last, self._last_ns = pose, pose_ns
        interval_s = max((pose_ns - last_ns) / NS_PER_S, _MIN_INTERVAL_S)
        if last is None:
            self._begin_anew(pose_ns)
            return
        change, turn = floats(pose.position - last.position), last.rotation.turn_to(pose.rotation)
        self._linear_drift.moved(change, interval_s)
        self._angular_drift.moved(turn, interval_s)
        if pose_ns - last_ns > _LONGEST_GAP_NS:
            self._begin_anew(pose_ns)
            return
        linear = _banded(
            times(change, 1.0 / interval_s),
            CLAMP_ABOVE_M_S,
            REJECT_ABOVE_M_S,
        )
        angular = _banded(
            times(turn, 1.0 / interval_s),
            CLAMP_ABOVE_RAD_S,
            REJECT_ABOVE_RAD_S,
        )
        if linear is None or angular is None:
            self.rejects += 1
            return
        self.rejects = 0
        self._accepted_ns = pose_ns
        self._linear, self._angular = linear, angular

    def _begin_anew(self, pose_ns: int) -> None:
        self._accepted_ns = pose_ns
        self._linear = self._angular = ZERO


def is_frozen(sample: ControllerSample, now_ns: int, limit_ms: float) -> bool:
    """Whether the pose has not changed, to the last bit, for `limit_ms` or longer."""
    return now_ns - sample.pose_ns >= limit_ms * NS_PER_MS


def _approach(smoothed: Floats3, value: Floats3, alpha: float) -> Floats3:
    return plus_times(smoothed, minus(value, smoothed), alpha)


def _banded(velocity: Floats3, clamp: float, reject: float) -> Floats3 | None:
    """Pass, clamp or (None) reject by the norm."""
    speed = norm(velocity)
    if speed <= clamp:
        return velocity
    if speed <= reject:
        return times(velocity, clamp / speed)
    return None


class Drift:
    """The motion that the arm was asked for beyond that of the hand, or less than it.

    That is its velocities as they were used, integrated, less the motion that it really made. A
    pose that comes late or not at all makes the two differ: a velocity is used for longer or
    shorter than the hand had it, and what a long gap has hidden is left out. Who chooses which
    poses come late can lead the arm away by a little with each. Differences add up by direction, so
    that those of a poor network cancel out; they are forgotten with a time constant of 1 s. Neither
    side counts for more than the arm would do at its fastest.
    """

    def __init__(self, fastest: float, limit: float) -> None:
        """Both in units of the hand: m/s and m, or rad/s and rad."""
        self._fastest = fastest
        self._limit = limit
        self._ahead = ZERO

    def clear(self) -> None:
        """Begin anew."""
        self._ahead = ZERO

    def used(self, velocity: Floats3, interval_s: float) -> None:
        """Take in that `velocity` was in force for `interval_s`."""
        kept = times(self._ahead, math.exp(-interval_s / _FORGETS_S))
        self._ahead = plus_times(kept, self._at_most(velocity), interval_s)

    def moved(self, change: Floats3, interval_s: float) -> None:
        """Take in that the hand moved by `change` to the next pose, made `interval_s` later."""
        if interval_s > 0.0:
            velocity = self._at_most(times(change, 1.0 / interval_s))
            self._ahead = minus(self._ahead, times(velocity, interval_s))

    @property
    def size(self) -> float:
        """The distance between the two."""
        return norm(self._ahead)

    @property
    def is_too_large(self) -> bool:
        """Whether they are apart by more than the limit."""
        return self.size > self._limit

    def _at_most(self, velocity: Floats3) -> Floats3:
        speed = norm(velocity)
        return velocity if speed <= self._fastest else times(velocity, self._fastest / speed)

"""The target pose that the twist is integrated to, and how the arm is kept at it.

The arm gets velocities, and a P-loop on the reported pose takes away what drifts. The report is
older than the last commands, so the loop compares with the *predicted* TCP: the reported pose plus
all that was commanded since.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from tams_app.config import LimitsConfig
from tams_app.records import Pose, Twist
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S
from tams_app.vectors import (
    ZERO,
    Floats3,
    floats,
    minus,
    norm,
    plus,
    plus_times,
    times,
)

_ARRIVED, _NOISE = 0.25, 0.04  # of a leash: the arm is where it should be; what reports may shake
_MEMORY_NS = NS_PER_S // 2


class Tcp(NamedTuple):
    """Position [m] and rotation of the tool centre point in the base frame; a `Pose` of floats."""

    position: Floats3
    rotation: Rotation

    @staticmethod
    def of(pose: Pose) -> Tcp:
        return Tcp(floats(pose.position), pose.rotation)


class TcpPredictor:
    """Predicts the TCP's present pose from an old report and the velocities sent since."""

    def __init__(self) -> None:
        self._linear = ZERO
        self._angular = ZERO
        self._travelled: deque[tuple[int, Floats3, Floats3]] = deque()

    def sent(self, twist: Twist, now_ns: int, interval_s: float) -> None:
        """The arm was given `twist` for the `interval_s` that ends at `now_ns`."""
        self._linear = plus_times(self._linear, twist.linear, interval_s)
        self._angular = plus_times(self._angular, twist.angular, interval_s)
        self._travelled.append((now_ns, self._linear, self._angular))
        while now_ns - self._travelled[0][0] > _MEMORY_NS:
            self._travelled.popleft()

    def predict(self, measured: Tcp, received_ns: int, delay_ns: int) -> Tcp:
        """The TCP now, from a report in which the last `delay_ns` of commands do not show yet."""
        linear, angular = self._travelled_until(received_ns - max(0, delay_ns))
        position = plus(measured.position, minus(self._linear, linear))
        return Tcp(position, measured.rotation.turned(minus(self._angular, angular)))

    def _travelled_until(self, t_ns: int) -> tuple[Floats3, Floats3]:
        """Displacement and turn that were commanded until `t_ns`, linear between ticks."""
        later_ns, linear, angular = t_ns, self._linear, self._angular
        for past_ns, past_linear, past_angular in reversed(self._travelled):
            if past_ns <= t_ns:
                if later_ns > t_ns:
                    share = (t_ns - past_ns) / (later_ns - past_ns)
                    linear = plus_times(past_linear, minus(linear, past_linear), share)
                    angular = plus_times(past_angular, minus(angular, past_angular), share)
                break
            later_ns, linear, angular = past_ns, past_linear, past_angular
        return linear, angular


class _Leash:
    """The limits of a target's distance from the arm, in one measure [m or rad]."""

    def __init__(self, length: float, fault: float) -> None:
        self._length = length
        self._fault = fault
        self.clear()

    @property
    def is_too_far(self) -> bool:
        """Whether the arm lags so far, counting what was kept back, that it is a fault."""
        return self.following_error > self._fault

    def clear(self) -> None:
        """Begin anew, with the arm at its target."""
        self.following_error = 0.0
        self._withheld = 0.0

    def watch(self, distance: float) -> None:
        """The arm reports to be this far from its target."""
        self.following_error = distance + self._withheld

    def share_kept(self, distance: float) -> float | None:
        """The share of a target's distance that the leash leaves it; None: all.

        What was kept back is forgiven once the arm is where it should be. A hand that turns back
        for a moment does not bring it there; at the leash, the noise of reports cancels out.
        """
        if distance <= _ARRIVED * self._length:
            self._withheld = 0.0
        elif distance > (1.0 - _NOISE) * self._length:
            self._withheld = max(0.0, self._withheld + distance - self._length)
        return None if distance <= self._length else self._length / distance


class Target:
    """The integrated target pose, on a leash to the measured one."""

    def __init__(self, limits: LimitsConfig) -> None:
        self._way = _Leash(limits.leash_mm / 1000.0, limits.leash_fault_mm / 1000.0)
        self._turn = _Leash(limits.leash_rad, limits.leash_fault_rad)
        self.tcp = Tcp(ZERO, Rotation.identity())

    @property
    def is_out_of_reach(self) -> bool:
        """Whether the arm lags so far in position or rotation that it is a fault."""
        return self._way.is_too_far or self._turn.is_too_far

    def anchor(self, measured: Tcp) -> None:
        """Start from where the arm is."""
        self.tcp = measured
        self._way.clear()
        self._turn.clear()

    def advance(self, linear: Floats3, angular: Floats3, interval_s: float) -> None:
        """Integrate a velocity [m/s] and an angular velocity [rad/s] over `interval_s`."""
        position = plus_times(self.tcp.position, linear, interval_s)
        self.tcp = Tcp(position, self.tcp.rotation.turned(times(angular, interval_s)))

    def watch(self, measured: Tcp) -> None:
        """Measure how far the arm is from where it should be."""
        offset, turn = self._from(measured)
        self._way.watch(norm(offset))
        self._turn.watch(norm(turn))

    def pull_back(self, measured: Tcp) -> None:
        """The target waits for the arm: never further from it than the leash."""
        offset, turn = self._from(measured)
        position, rotation = self.tcp
        if (kept := self._way.share_kept(norm(offset))) is not None:
            position = plus_times(measured.position, offset, kept)
        if (kept := self._turn.share_kept(norm(turn))) is not None:
            rotation = measured.rotation.turned(times(turn, kept))
        self.tcp = Tcp(position, rotation)

    def _from(self, measured: Tcp) -> tuple[Floats3, Floats3]:
        offset = minus(self.tcp.position, measured.position)
        return offset, measured.rotation.turn_to(self.tcp.rotation)

"""What the arm may do, judged from its own reports and from what the control loop says it asks for.

Pure: times, beats and reports come in, the cause of a stop comes out. It shares no code with the
control loop, whose mistakes it is there to notice.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple, TypeAlias

from hw.arm_report import ArmReport
from tams_app.units import NS_PER_MS, NS_PER_S

REST_M, REST_RAD = 0.005, 0.02  # an arm that is to stand may be this far from where it came to rest
CREPT_RAD = 0.05  # ... and have crept no further, however slowly: sag and drift are far less
_TURNED_RAD = 0.001  # noise is less; a TCP that moves and no joint does has got another tool
_DRIFT_M_S, _DRIFT_RAD_S = 0.002, 0.002  # slower than this is no motion: that place follows
_SPEED_MARGIN = 1.1
_SPEED_MARGIN_M_S, _SPEED_MARGIN_RAD_S = 0.025, 0.02
_NOISE_M, _NOISE_RAD = 0.0025, 0.05
_STEP_NS = 50 * NS_PER_MS  # between two places that are compared: noise of reports adds up in less
_JITTER_NS = 30 * NS_PER_MS  # by which the age of two reports may differ
_GAP_KEPT_NS = NS_PER_S
_LONGEST_GAP_NS = 300 * NS_PER_MS
_ANEW_NS = NS_PER_S  # after so long without a report nothing from before is compared
_OUTSIDE_REPORTS = 2  # in a row


_Apart: TypeAlias = Callable[[Sequence[float], Sequence[float]], float]


class Motion(IntEnum):
    """What the application has the arm do."""

    REST = 0
    FOLLOW = 1  # the operator's hand: ENGAGED
    HOME = 2  # move to the ready pose


class Cause(IntEnum):
    """Why the guard stopped the arm."""

    NONE = 0
    SILENT = 1  # no heartbeat
    UNASKED = 2  # it moved, and nothing was commanded
    TOO_FAST = 3  # faster than commanded, or than allowed
    OUTSIDE = 4  # of the fence
    SLEPT = 5  # the computer was suspended


class MotionLimits(NamedTuple):
    """What is allowed, in metres and radians in the base frame."""

    grace_ns: int  # after a motion until the arm must stand
    speed_m_s: float  # of the TCP that follows the hand
    home_rad_s: float  # of the fastest joint on its way to the ready pose
    leash_m: float  # by which the arm may lag behind what is commanded, and catch up
    low: Sequence[float]  # of the box: x, y, z
    high: Sequence[float]
    radius_min: float  # of the ring about the base axis
    radius_max: float
    floor: float
    margin_m: float  # beyond the fence

    def excess(self, position: Sequence[float], motion: Motion) -> tuple[float, ...]:
        """How far a position is outside each bound of a motion [m], negative inside."""
        x, y, z = position
        if motion is Motion.HOME:  # it may begin anywhere above the floor
            return (self.floor - z,)
        radius = math.hypot(x, y)
        below = (low - value for low, value in zip(self.low, position, strict=True))
        above = (value - high for high, value in zip(self.high, position, strict=True))
        return (
            *below,
            *above,
            self.floor - z,
            self.radius_min - radius,
            radius - self.radius_max,
        )


class MotionWatch:
    """Judges each report; `begin` with an arming, then `hear` every beat and `look` at reports.

    - At rest: from `grace_ns` after the last motion that was commanded on, the TCP stays within
      5 mm and every joint within 0.02 rad of where it came to rest. That place follows what is
      slower than 2 mm/s and 0.002 rad/s, until a joint has crept 0.05 rad. A TCP that moves while
      no joint does has got another tool (a control box that restarts has forgotten its own).
    - Speed: what the TCP (on the way home: the fastest joint) travels beyond 1.1 times the highest
      speed that was commanded within `grace_ns`, and 25 mm/s (0.02 rad/s), adds up to no more than
      the leash, 2.5 mm (0.05 rad) of noise, and the way at that speed within 30 ms and the longest
      gap between two reports of the last second. A sum over time, so that reports which come late
      or in bursts change nothing: they are as far apart on the whole as they were sent.
    - Fence: two reports in a row beyond a bound by more than `margin_m`. From outside every place
      further in moves that limit along, so that inward is free and back out is not.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._motion = Motion.FOLLOW  # that was commanded last
        self._commanded: deque[tuple[int, float]] = deque()  # (when, speed) of that motion
        self._moving_ns = 0  # when it last was
        self._last: _Seen | None = None
        self._gap_ns = self._gap_until_ns = 0
        self._rest: _Place | None = None
        self._ahead = _Ahead()
        self._least: list[float] = []  # of the excess at each bound since the arming
        self._outside = 0

    def begin(self, now_ns: int) -> None:
        """A new arming, at rest: the arm may still come to rest from what was before."""
        self._commanded.clear()
        self._moving_ns = now_ns
        self._forget()

    def hear(self, now_ns: int, motion: Motion, speed: float) -> None:
        """What the control loop has the arm do, and how fast at most [m/s; rad/s on its way home].

        FOLLOW with the deadman up is for the caller to call REST.
        """
        while self._commanded and now_ns - self._commanded[0][0] > self._limits.grace_ns:
            self._commanded.popleft()
        if motion is Motion.REST:
            return
        if motion is not self._motion:
            self._motion = motion
            self._commanded.clear()
            self._ahead.reset()
            self._least = []
        self._commanded.append((now_ns, speed))
        self._moving_ns = now_ns

    def look(self, before_ns: int, after_ns: int, report: ArmReport) -> Cause:
        """Judge a report that was received between these two times; why to stop, if at all."""
        last, self._last = self._last, _Seen(before_ns, after_ns, report)
        if last is None or before_ns - last.after_ns > _ANEW_NS:
            self._forget()
            self._last = _Seen(before_ns, after_ns, report)
            last = self._last
        if after_ns - self._moving_ns > self._limits.grace_ns:
            self._ahead.reset()
            return self._at_rest(report, (after_ns - last.before_ns) / NS_PER_S)
        self._rest = None
        self._note_gap(after_ns - last.before_ns, after_ns)
        return self._beyond_the_fence(report) or self._too_fast(before_ns, after_ns, report)

    def _forget(self) -> None:
        self._last = None
        self._rest = None
        self._ahead.reset()
        self._least = []
        self._outside = 0

    def _at_rest(self, report: ArmReport, elapsed_s: float) -> Cause:
        rest = self._rest
        if rest is None:
            self._rest = _Place(list(report.position), list(report.joints), report.joints)
            return Cause.NONE
        moved_m = math.dist(report.position, rest.position)
        turned_rad = _most_apart(report.joints, rest.joints)
        if turned_rad > REST_RAD or (moved_m > REST_M and turned_rad > _TURNED_RAD):
            return Cause.UNASKED
        if _most_apart(report.joints, rest.first_joints) > CREPT_RAD:
            return Cause.UNASKED
        if moved_m > REST_M:
            rest.position[:] = report.position
        _follow(rest.position, report.position, moved_m, _DRIFT_M_S * elapsed_s)
        _follow(rest.joints, report.joints, turned_rad, _DRIFT_RAD_S * elapsed_s)
        return Cause.NONE

    def _beyond_the_fence(self, report: ArmReport) -> Cause:
        excess = self._limits.excess(report.position, self._motion)
        self._least = list(map(min, self._least, excess)) if self._least else list(excess)
        margin_m = self._limits.margin_m
        beyond = any(
            here > max(least, 0.0) + margin_m
            for here, least in zip(excess, self._least, strict=True)
        )
        self._outside = self._outside + 1 if beyond else 0
        return Cause.OUTSIDE if self._outside >= _OUTSIDE_REPORTS else Cause.NONE

    def _note_gap(self, gap_ns: int, now_ns: int) -> None:
        """Keep the longest gap of the last second: a place may be as old as that."""
        if gap_ns >= self._gap_ns or now_ns > self._gap_until_ns:
            self._gap_ns, self._gap_until_ns = gap_ns, now_ns + _GAP_KEPT_NS

    def _too_fast(self, before_ns: int, after_ns: int, report: ArmReport) -> Cause:
        commanded = max((speed for _, speed in self._commanded), default=0.0)
        apart: _Apart
        if self._motion is Motion.HOME:
            place: Sequence[float] = report.joints
            speed = _SPEED_MARGIN * min(commanded, self._limits.home_rad_s) + _SPEED_MARGIN_RAD_S
            slack, apart = _NOISE_RAD, _most_apart
        else:
            place = report.position
            speed = _SPEED_MARGIN * min(commanded, self._limits.speed_m_s) + _SPEED_MARGIN_M_S
            slack, apart = self._limits.leash_m + _NOISE_M, math.dist
        ahead = self._ahead.step(before_ns, after_ns, place, speed, apart)
        late_ns = _JITTER_NS + min(self._gap_ns, _LONGEST_GAP_NS)
        return Cause.TOO_FAST if ahead > slack + speed * late_ns / NS_PER_S else Cause.NONE


class _Seen(NamedTuple):
    """A report, and between which times it was received."""

    before_ns: int
    after_ns: int
    report: ArmReport


class _Place(NamedTuple):
    """Where the arm came to rest, and has crept to since."""

    position: list[float]
    joints: list[float]
    first_joints: Sequence[float]  # where it came to rest


class _Ahead:
    """How far something has got beyond what its speed allows, since it last was not beyond."""

    def __init__(self) -> None:
        self._from: tuple[int, Sequence[float]] | None = None
        self._carried = 0.0

    def reset(self) -> None:
        self._from = None
        self._carried = 0.0

    def step(
        self, before_ns: int, after_ns: int, place: Sequence[float], speed: float, apart: _Apart
    ) -> float:
        """Take in a place that was received between two times; how far ahead it is now."""
        if self._from is None:
            self._from = (before_ns, place)
        from_ns, there = self._from
        ahead = self._carried + apart(place, there) - speed * (after_ns - from_ns) / NS_PER_S
        if after_ns - from_ns >= _STEP_NS:
            self._from, self._carried = (before_ns, place), max(ahead, 0.0)
        return ahead


def _most_apart(here: Sequence[float], there: Sequence[float]) -> float:
    return max(abs(a - b) for a, b in zip(here, there, strict=True))


def _follow(place: list[float], towards: Sequence[float], apart: float, most: float) -> None:
    """Move `place` by at most `most` towards what is `apart` from it."""
    share = min(1.0, most / apart) if apart > 0.0 else 0.0
    for axis, (here, there) in enumerate(zip(place, towards, strict=True)):
        place[axis] = here + share * (there - here)

"""The controller's servos from commands to joint targets, one 4 ms cycle at a time.

The servo of mode 5, the moves of mode 0, and the brake that ends all motion. Each works on
the commanded joints [rad]; `check_motion` checks what comes out.
"""

from __future__ import annotations

import math

from hw.arm import TcpBoundary
from hw.lite6.kinematics import (
    BASE_TO_SHOULDER_M,
    JOINT_RANGES,
    JOINT_SPEED_LIMITS,
    Lite6Model,
    Matrix,
    links,
    placed,
    rotation_matrix,
    within_joint_limits,
)
from hw.lite6.protocol import ErrorCode
from tams_app.vectors import (
    ZERO,
    Floats3,
    Joints,
    Numbers,
    floats,
    plain,
    plus,
    plus_times,
    times,
    towards,
)

CYCLE_NS = 4_000_000  # the box runs at 250 Hz
CYCLE_S = CYCLE_NS / 1e9

MAX_JOINT_ACCELERATION = 20.0  # [rad/s²], the SDK's upper bound (__get_joint_motion_params)

# Mode 5 follows its command with an acceleration of the controller's own, which UFACTORY does not
# publish and no register changes (xArm-Python-SDK issue 43). These are its joint limit at the
# middle of our workspace: 20 rad/s² at 350 mm; 250 mm/s to rest within 36 ms.
VELOCITY_ACCELERATION_M_S2 = 7.0
VELOCITY_ACCELERATION_RAD_S2 = 20.0

_MAX_JOINT_SPEED_RAD_S = float(JOINT_SPEED_LIMITS.min())
AT_REST: Joints = (0.0,) * 6  # joint speeds
_NO_TWIST = ZERO, ZERO  # linear and angular


class TwistServo:
    """Mode 5: the TCP moves with a commanded twist until the next command or its deadman time."""

    def __init__(self) -> None:
        self._command = _NO_TWIST
        self._deadline_ns: int | None = None
        self._twist = _NO_TWIST
        self._path: tuple[Floats3, Matrix] | None = None  # the TCP as commanded; None at rest

    def command(self, twist: Numbers, duration_s: float, now_ns: int) -> None:
        """Move with `twist` [m/s, rad/s]; a `duration_s` that is not positive means for ever."""
        x, y, z, *angular = plain(twist)
        about_x, about_y, about_z = angular
        self._command = (x, y, z), (about_x, about_y, about_z)
        self._deadline_ns = now_ns + round(duration_s * 1e9) if duration_s > 0 else None

    def clear(self) -> None:
        self._command = self._twist = _NO_TWIST
        self._deadline_ns = None
        self._path = None

    def step(self, joints: Joints, model: Lite6Model, now_ns: int) -> Joints | None:
        """The joints one cycle later; None at rest."""
        if self._deadline_ns is not None and now_ns >= self._deadline_ns:
            self._command = _NO_TWIST
            self._deadline_ns = None
        if self._command == self._twist == _NO_TWIST:
            self._path = None
            return None
        linear, angular = self._twist = (
            towards(self._twist[0], self._command[0], VELOCITY_ACCELERATION_M_S2 * CYCLE_S),
            towards(self._twist[1], self._command[1], VELOCITY_ACCELERATION_RAD_S2 * CYCLE_S),
        )
        if self._path is None:
            tcp = model.tcp_matrix(joints)
            self._path = floats(tcp[:3, 3]), tcp[:3, :3]
        place, turn = self._path
        if angular != ZERO:
            turn = rotation_matrix(times(angular, CYCLE_S)) @ turn
        self._path = plus_times(place, linear, CYCLE_S), turn
        following = model.approach(*self._path, joints)
        if following is None:
            raise MotionError(ErrorCode.KINEMATIC)
        return following


def brake(joints: Joints, velocity: Joints) -> tuple[Joints, Joints]:
    """Joints and joint velocity [rad/s] one cycle later, stopping on the line they moved along."""
    fastest = max(map(abs, velocity))
    if fastest <= MAX_JOINT_ACCELERATION * CYCLE_S:
        return joints, AT_REST
    share = 1.0 - MAX_JOINT_ACCELERATION * CYCLE_S / fastest
    slower = tuple(speed * share for speed in velocity)
    following = tuple(
        min(max(at + speed * CYCLE_S, low), high)
        for at, speed, (low, high) in zip(joints, slower, JOINT_RANGES, strict=True)
    )
    return following, slower


def farthest(joints: Joints, others: Joints) -> float:
    """The greatest way of a joint from `joints` to `others` [rad]."""
    return max(abs(other - at) for at, other in zip(joints, others, strict=True))


class MotionError(Exception):
    """Motion that the controller refuses; it stops with this error code."""

    def __init__(self, code: ErrorCode) -> None:
        super().__init__(f"controller error C{code.value}: {code.name.lower()}")
        self.code = code


class CommandError(Exception):
    """A request the controller cannot make sense of; it changes nothing."""


# The base column and the last links as capsules: half their widths together. At zero joints, a
# pose the real arm allows, the flange is 87 mm from the column's axis.
KEEP_OUT_RADIUS_M = 0.075

_WRIST_LINK = 4
_SPEED_MARGIN = 1.0 + 1e-6  # a servo at its limit is not above it


def check_motion(
    joints: Joints,
    following: Joints,
    tool: Floats3,
    fence: TcpBoundary | None,
    self_collision: bool,
) -> None:
    """MotionError if the step from `joints` to `following` within a cycle is not allowed.

    `tool`: the TCP in the flange's frame [m].
    """
    if not within_joint_limits(following):
        raise MotionError(ErrorCode.JOINT_LIMIT)
    fastest = farthest(joints, following) / CYCLE_S
    if fastest > _MAX_JOINT_SPEED_RAD_S * _SPEED_MARGIN:
        raise MotionError(ErrorCode.JOINT_OVERSPEED)
    frames = links(following)
    tcp = placed(frames[-1], tool)
    if fence is not None and not fence.contains(tcp):
        raise MotionError(ErrorCode.BOUNDARY)
    if self_collision and _hits_base(frames[_WRIST_LINK][3], frames[-1][3], tcp):
        raise MotionError(ErrorCode.SELF_COLLISION)


def _hits_base(wrist: Floats3, flange: Floats3, tcp: Floats3) -> bool:
    """True if the line through wrist, flange and TCP comes too near the base column."""
    points = (wrist, _middle(wrist, flange), flange, _middle(flange, tcp), tcp)
    return any(
        math.hypot(x, y, max(z - BASE_TO_SHOULDER_M, 0.0)) < KEEP_OUT_RADIUS_M for x, y, z in points
    )


def _middle(a: Floats3, b: Floats3) -> Floats3:
    return times(plus(a, b), 0.5)


class JointMove:
    """A straight line in joint space with a trapezoidal speed profile."""

    def __init__(self, start: Joints, goal: Joints, speed: float, acceleration: float) -> None:
        """`speed` [rad/s] and `acceleration` [rad/s²] of the joint that turns furthest."""
        self._start, self._goal = start, goal
        self._travel = farthest(start, goal)
        self._acceleration = min(acceleration, MAX_JOINT_ACCELERATION)
        # a travel too short for the full speed has a triangle for a profile
        fastest = math.sqrt(self._travel * self._acceleration)
        self._speed = min(speed, _MAX_JOINT_SPEED_RAD_S, fastest)
        self._elapsed_s = 0.0

    @property
    def duration_s(self) -> float:
        if self._travel == 0.0:
            return 0.0
        return self._travel / self._speed + self._speed / self._acceleration

    @property
    def done(self) -> bool:
        return self._elapsed_s >= self.duration_s

    def step(self) -> Joints:
        """The joints one cycle later."""
        self._elapsed_s += CYCLE_S
        if self.done:
            return self._goal
        fraction = self._travelled(self._elapsed_s) / self._travel
        return tuple(
            at + fraction * (end - at) for at, end in zip(self._start, self._goal, strict=True)
        )

    def _travelled(self, elapsed_s: float) -> float:
        ramp_s = self._speed / self._acceleration
        if elapsed_s < ramp_s:
            return 0.5 * self._acceleration * elapsed_s**2
        remaining_s = self.duration_s - elapsed_s
        if remaining_s < ramp_s:
            return self._travel - 0.5 * self._acceleration * remaining_s**2
        return self._speed * (elapsed_s - 0.5 * ramp_s)


class MoveServo:
    """Mode 0: a joint move from rest to rest, one at a time."""

    def __init__(self) -> None:
        self._wanted: tuple[Joints, float, float] | None = None  # goal, speed, acceleration
        self._move: JointMove | None = None  # once it has begun

    @property
    def busy(self) -> bool:
        """True while a move is not finished."""
        return self._wanted is not None

    def command(self, goal: Joints, speed: float, acceleration: float) -> None:
        """Begin a move in the next cycle; CommandError behind another, which the box would queue.

        The driver makes the arm ready before each move, and that ends an earlier one.
        """
        if self.busy:
            raise CommandError("a second move is not modelled")
        self._wanted = goal, speed, acceleration

    def clear(self) -> None:
        self._wanted = self._move = None

    def interrupt(self) -> None:
        """Leave the move unfinished; it starts again from wherever the joints come to."""
        self._move = None

    def step(self, joints: Joints) -> Joints | None:
        """The joints one cycle later; None when there is nothing to do."""
        if self._wanted is None:
            return None
        self._move = self._move or JointMove(joints, *self._wanted)
        following = self._move.step()
        if self._move.done:
            self.clear()
        return following

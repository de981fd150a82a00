"""Mode 0 of the controller: queued moves in joint space, one 4 ms cycle at a time."""

from __future__ import annotations

import math
from collections import deque

from hw.lite6.kinematics import JOINT_SPEED_LIMITS
from hw.sim.controller.joint_servo import (
    CYCLE_S,
    MAX_JOINT_ACCELERATION,
    CommandError,
    farthest,
)
from tams_app.vectors import Joints

MAX_QUEUED_MOVES = 1024  # XCONF.MAX_CMD_NUM


class JointMove:
    """A straight line in joint space with a trapezoidal speed profile."""

    def __init__(self, start: Joints, goal: Joints, speed: float, acceleration: float) -> None:
        """`speed` [rad/s] and `acceleration` [rad/s²] of the joint that turns furthest."""
        self.goal = goal
        self.speed = speed
        self.acceleration = acceleration
        self._start = start
        self._travel = farthest(start, goal)
        self._acceleration = min(acceleration, MAX_JOINT_ACCELERATION)
        # a travel too short for the full speed has a triangle for a profile
        fastest = math.sqrt(self._travel * self._acceleration)
        self._speed = min(speed, float(JOINT_SPEED_LIMITS.min()), fastest)
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
            return self.goal
        fraction = self._travelled(self._elapsed_s) / self._travel
        return tuple(
            at + fraction * (end - at) for at, end in zip(self._start, self.goal, strict=True)
        )

    def _travelled(self, elapsed_s: float) -> float:
        ramp_s = self._speed / self._acceleration
        if elapsed_s < ramp_s:
            return 0.5 * self._acceleration * elapsed_s**2
        remaining_s = self.duration_s - elapsed_s
        if remaining_s < ramp_s:
            return self._travel - 0.5 * self._acceleration * remaining_s**2
        return self._speed * (elapsed_s - 0.5 * ramp_s)


class MoveQueue:
    """Moves that run one after the other, each from rest to rest."""

    def __init__(self) -> None:
        self._current: JointMove | None = None
        self._waiting: deque[tuple[Joints, float, float]] = deque()

    def __len__(self) -> int:
        """Moves not finished yet."""
        return len(self._waiting) + (self._current is not None)

    def command(self, goal: Joints, speed: float, acceleration: float) -> None:
        """Queue a move; an infinite angle in `goal` leaves its joint where the move before ends."""
        if len(self) >= MAX_QUEUED_MOVES:
            raise CommandError("the command queue is full")
        self._waiting.append((goal, speed, acceleration))

    def clear(self) -> None:
        self._current = None
        self._waiting.clear()

    def interrupt(self) -> None:
        """Leave the current move unfinished; it starts again from wherever the joints come to."""
        if self._current is not None:
            move, self._current = self._current, None
            self._waiting.appendleft((move.goal, move.speed, move.acceleration))

    def step(self, joints: Joints) -> Joints | None:
        """The joints one cycle later; None when there is nothing to do."""
        if self._current is None:
            if not self._waiting:
                return None
            goal, speed, acceleration = self._waiting.popleft()
            goal = tuple(
                at if math.isinf(end) else end for at, end in zip(joints, goal, strict=True)
            )
            self._current = JointMove(joints, goal, speed, acceleration)
        following = self._current.step()
        if self._current.done:
            self._current = None
        return following

"""Pick and place as a person does it: what the tool should do next, from what is seen.

The task is independent of hands, clutches and button mappings: it gives the tool's motion, its
mode, and what the thumb presses. All of it is in the arm's base frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial

import numpy as np

from hw.sim.layout import BLOCK_EDGE_M, CONTAINER_INNER_M
from hw.sim.operator.hand import ThumbButton
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import ViewSight, approach, grasp_turn, norm, speed_factor
from tams_app.records import Vector
from tams_app.units import NS_PER_S

TRAVEL_HEIGHT_M = (0.12, 0.20)  # the tool's, over whatever stands on the table
GRASP_ABOVE_CENTRE_M = 0.001
GRASP_FLOOR_M = 0.0095  # the limits' floor is at 5 mm and slows the arm above it
RELEASE_HEIGHT_M = 0.026  # the block's bottom is then below the container's rim
LIFTED_M = 0.035  # by then the block must have come along
HELD_WITHIN_M = 0.03
TURN_SPEED_RAD_S = 0.4
FINE_BELOW_M = 0.05  # above its end a descent is twice as fast

# How sure operators want to be: half of what there is room for, so that two sigma fit.
_REACH_SURE_M = 0.020  # over a thing, before it is looked at from near
_DESCENT_SURE_M = 0.004
_GRASP_SURE_M = 0.001  # the open fingers leave 2 mm on either side
_PLACE_SURE_M = 0.015  # the container leaves 39 mm
_TURN_SURE_RAD = math.radians(4.0)
_OVERDUE_PART = 0.25  # of full speed
_NO_IDEA = 6.0  # times what is needed: then there is nothing to go by, and they wait longer
_LONGER = 4.0  # times the wait limit; then they go on all the same

_REACH_TOLERANCE_M = 0.004
_GRASP_TOLERANCE_M = 0.0015
_PLACE_TOLERANCE_M = 0.006
_TURN_TOLERANCE_RAD = math.radians(1.2)
_TURN_AGAIN_RAD = math.radians(4.0)
_SETTLE_NS = 150_000_000
_PRESS_NS = 150_000_000
_FINGERS_REST_NS = 300_000_000  # unchanged for so long: they have arrived
_FINGERS_LIMIT_NS = 2_000_000_000
_FINGERS_UNSEEN_NS = 1_200_000_000
_FINGERS_STEP_M = 0.0003
_LOST_NS = 300_000_000
_FINGERS_READY_M = BLOCK_EDGE_M + 0.002


class Stage(StrEnum):
    """Stage of the task."""

    REACH = "reach"
    TURN = "turn"
    DESCEND = "descend"
    CLOSE = "close"
    LIFT = "lift"
    CARRY = "carry"
    LOWER = "lower"
    OPEN = "open"
    RETREAT = "retreat"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Intent:
    """The intended motion of the tool now [m/s], [rad/s], and the thumb's presses.

    `turning` asks for orientation mode; None: either will do, since nothing is to move.
    """

    linear: Vector = field(default_factory=partial(np.zeros, 3))
    angular: Vector = field(default_factory=partial(np.zeros, 3))
    turning: bool | None = None
    button: ThumbButton | None = None
    done: bool = False


_HOLD = Intent()


class PickAndPlace:
    """The task's stages; `step` is called while the hand can act on what it returns."""

    def __init__(
        self, traits: ParticipantProfile, hand_scale: float, random: np.random.Generator
    ) -> None:
        """`hand_scale`: the tool's travel over the hand's."""
        self.stage = Stage.REACH
        self._traits = traits
        self._reach_speed = traits.reach_speed_m_s * hand_scale
        self._fine_speed = traits.fine_speed_m_s * min(1.0, hand_scale)
        self._wait_limit_ns = traits.wait_limit_s * NS_PER_S
        self._waits_since_ns: int | None = None
        self._random = random
        self._begins_ns = 0
        self._arrived_ns: int | None = None
        self._fingers: tuple[int, float] | None = None  # last change and opening
        self._lost_ns: int | None = None
        self._grasp_block_z = 0.0
        self._grasp_tcp_z = 0.0
        self._steps = {
            Stage.REACH: self._reach,
            Stage.TURN: self._turn,
            Stage.DESCEND: self._descend,
            Stage.CLOSE: self._close,
            Stage.LIFT: self._lift,
            Stage.CARRY: self._carry,
            Stage.LOWER: self._lower,
            Stage.OPEN: self._open,
            Stage.RETREAT: self._retreat,
        }

    def step(self, now_ns: int, sight: ViewSight) -> Intent:
        """The intent at `now_ns`, given what is seen."""
        if now_ns < self._begins_ns:
            return _HOLD
        if self.stage is Stage.DONE:
            return Intent(done=True)
        return self._steps[self.stage](now_ns, sight)

    # --- the stages -----------------------------------------------------------------------------

    def _reach(self, now_ns: int, sight: ViewSight) -> Intent:
        opening = sight.percept.fingers_opening
        if opening is not None and opening < _FINGERS_READY_M:
            return self._enter(Stage.OPEN, now_ns)
        error = self._travel_error(sight, sight.block)
        if self._settled(now_ns, error, _REACH_TOLERANCE_M):
            turn = self._turn_left(sight)
            return self._enter(
                Stage.TURN if norm(turn) > _TURN_TOLERANCE_RAD else Stage.DESCEND, now_ns
            )
        factor = self._speed_factor(now_ns, sight.percept.gaps.block, _REACH_SURE_M)
        return Intent(linear=self._approach(error, self._reach_speed * factor), turning=False)

    def _turn(self, now_ns: int, sight: ViewSight) -> Intent:
        turn = self._turn_left(sight)
        if self._settled(now_ns, turn, _TURN_TOLERANCE_RAD):
            return self._enter(Stage.DESCEND, now_ns)
        factor = self._speed_factor(now_ns, sight.percept.gaps.heading, _TURN_SURE_RAD)
        return Intent(angular=self._approach(turn, TURN_SPEED_RAD_S * factor), turning=True)

    def _descend(self, now_ns: int, sight: ViewSight) -> Intent:
        goal = sight.block.copy()
        goal[2] = max(goal[2] + GRASP_ABOVE_CENTRE_M, GRASP_FLOOR_M)
        error = goal - sight.tcp
        height = -error[2]
        if height > 0.03 and norm(self._turn_left(sight)) > _TURN_AGAIN_RAD:
            return self._enter(Stage.TURN, now_ns)
        if self._settled(now_ns, error, _GRASP_TOLERANCE_M):
            self._grasp_block_z = sight.block[2]
            self._grasp_tcp_z = sight.percept.tcp.position[2]
            return self._enter(Stage.CLOSE, now_ns)
        needed = _GRASP_SURE_M if height < FINE_BELOW_M else _DESCENT_SURE_M
        sure = self._speed_factor(now_ns, sight.percept.gaps.block, needed)
        return self._lower_to(error, sure, funnel_m=0.003 + 0.15 * max(0.0, height))

    def _close(self, now_ns: int, sight: ViewSight) -> Intent:
        return self._press(ThumbButton.A, Stage.LIFT, now_ns, sight)

    def _lift(self, now_ns: int, sight: ViewSight) -> Intent:
        if self._came_away_empty(sight):
            return self._enter(Stage.OPEN, now_ns)
        height = TRAVEL_HEIGHT_M[0] - sight.tcp[2]
        if height < 0.01:
            return self._enter(Stage.CARRY, now_ns)
        error = np.array([0.0, 0.0, height])
        return Intent(linear=self._approach(error, 2.0 * self._fine_speed), turning=False)

    def _carry(self, now_ns: int, sight: ViewSight) -> Intent:
        if self._dropped(now_ns, sight):
            return self._enter(Stage.OPEN, now_ns)
        error = self._travel_error(sight, sight.percept.container.position)
        if self._settled(now_ns, error, _PLACE_TOLERANCE_M):
            return self._enter(Stage.LOWER, now_ns)
        factor = self._speed_factor(now_ns, sight.percept.gaps.container, _REACH_SURE_M)
        return Intent(linear=self._approach(error, self._reach_speed * factor), turning=False)

    def _lower(self, now_ns: int, sight: ViewSight) -> Intent:
        if self._dropped(now_ns, sight):
            return self._enter(Stage.OPEN, now_ns)
        goal = sight.percept.container.position.copy()
        goal[2] = RELEASE_HEIGHT_M
        error = goal - sight.tcp
        if self._settled(now_ns, error, _PLACE_TOLERANCE_M):
            return self._enter(Stage.OPEN, now_ns)
        sure = self._speed_factor(now_ns, sight.percept.gaps.container, _PLACE_SURE_M)
        return self._lower_to(error, sure, funnel_m=0.02)

    def _open(self, now_ns: int, sight: ViewSight) -> Intent:
        return self._press(ThumbButton.B, Stage.RETREAT, now_ns, sight)

    def _retreat(self, now_ns: int, sight: ViewSight) -> Intent:
        height = TRAVEL_HEIGHT_M[0] - sight.tcp[2]
        if height > 0.02:
            error = np.array([0.0, 0.0, height])
            return Intent(linear=self._approach(error, 2.0 * self._fine_speed), turning=False)
        return self._enter(Stage.DONE if _is_placed(sight) else Stage.REACH, now_ns)

    # --- what the stages share ------------------------------------------------------------------

    def _enter(self, stage: Stage, now_ns: int) -> Intent:
        self.stage = stage
        self._arrived_ns = None
        self._fingers = None
        self._lost_ns = None
        self._waits_since_ns = None
        reaction_s = self._traits.reaction_s * self._random.uniform(0.8, 1.3)
        self._begins_ns = now_ns + round(reaction_s * NS_PER_S)
        return _HOLD

    def _settled(self, now_ns: int, error: Vector, tolerance: float) -> bool:
        """True if `error` has stayed within `tolerance` for the settling time."""
        if error @ error > tolerance**2:
            self._arrived_ns = None
            return False
        if self._arrived_ns is None:
            self._arrived_ns = now_ns
        return now_ns - self._arrived_ns >= _SETTLE_NS

    def _travel_error(self, sight: ViewSight, target: Vector) -> Vector:
        """The displacement to above `target`, at travelling height; when too low, first up."""
        tcp = sight.tcp
        error: Vector = target - tcp
        error[2] = min(max(tcp[2], TRAVEL_HEIGHT_M[0]), TRAVEL_HEIGHT_M[1]) - tcp[2]
        if error[2] > 0.03:
            error[:2] = 0.0
        return error

    def _lower_to(self, error: Vector, sure: float, funnel_m: float) -> Intent:
        """Go down while over the goal to within `funnel_m`, correcting sideways meanwhile."""
        sideways: Vector = np.array([error[0], error[1], 0.0])
        centred = max(0.0, 1.0 - norm(sideways) / funnel_m)
        far = abs(error[2]) > FINE_BELOW_M
        speed = self._fine_speed * (2.0 if far else 1.0) * sure
        down = np.array([0.0, 0.0, error[2]])
        velocity = self._approach(sideways, self._fine_speed * sure)
        velocity = velocity + self._approach(down, speed * centred)
        return Intent(linear=velocity, turning=False)

    def _press(self, button: ThumbButton, then: Stage, now_ns: int, sight: ViewSight) -> Intent:
        """Press for a moment, then wait until the fingers have come to rest."""
        elapsed_ns = now_ns - self._begins_ns
        if elapsed_ns < _PRESS_NS:
            return Intent(button=button)
        if elapsed_ns >= _FINGERS_LIMIT_NS or self._fingers_at_rest(now_ns, elapsed_ns, sight):
            return self._enter(then, now_ns)
        return _HOLD

    def _fingers_at_rest(self, now_ns: int, elapsed_ns: int, sight: ViewSight) -> bool:
        opening = sight.percept.fingers_opening
        if opening is None:
            return elapsed_ns >= _FINGERS_UNSEEN_NS
        if self._fingers is None or abs(opening - self._fingers[1]) > _FINGERS_STEP_M:
            self._fingers = (now_ns, opening)
        return now_ns - self._fingers[0] >= _FINGERS_REST_NS

    def _came_away_empty(self, sight: ViewSight) -> bool:
        if not _sees_block(sight):
            return False
        risen = sight.percept.tcp.position[2] - self._grasp_tcp_z
        return bool(risen > LIFTED_M and sight.block[2] - self._grasp_block_z < 0.5 * risen)

    def _dropped(self, now_ns: int, sight: ViewSight) -> bool:
        """True if the block has been away from the fingers for longer than a glance."""
        percept = sight.percept
        gap = percept.tcp.position - percept.block.position
        if not _sees_block(sight) or gap @ gap <= HELD_WITHIN_M**2:
            self._lost_ns = None
            return False
        if self._lost_ns is None:
            self._lost_ns = now_ns
        return now_ns - self._lost_ns >= _LOST_NS

    @staticmethod
    def _turn_left(sight: ViewSight) -> Vector:
        percept = sight.percept
        turn = grasp_turn(percept.tcp.rotation, percept.block.rotation)
        return turn - sight.turned

    def _approach(self, error: Vector, speed: float) -> Vector:
        return approach(error, speed, self._traits.gain_per_s)

    def _speed_factor(self, now_ns: int, sigma: float, needed: float) -> float:
        """The part of full speed to move at; after the wait limit some of it, however uncertain."""
        factor = speed_factor(sigma, needed)
        if factor >= _OVERDUE_PART:
            self._waits_since_ns = None
            return factor
        if self._waits_since_ns is None:
            self._waits_since_ns = now_ns
        limit_ns = self._wait_limit_ns * (_LONGER if sigma > _NO_IDEA * needed else 1.0)
        return _OVERDUE_PART if now_ns - self._waits_since_ns >= limit_ns else factor


def _sees_block(sight: ViewSight) -> bool:
    return sight.percept.block_sigma < HELD_WITHIN_M / 3.0


def _is_placed(sight: ViewSight) -> bool:
    """True if the block lies in the container, as far as can be seen."""
    container = sight.percept.container
    offset = container.rotation.inv().apply(sight.block - container.position)
    return bool(np.abs(offset[:2]).max() < CONTAINER_INNER_M / 2 and sight.block[2] < 0.05)

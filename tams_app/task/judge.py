"""The rules of a pick-and-place trial, judged on the simulated rig (paper, IV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tams_app.config import TrialConfig
from tams_app.records import Outcome, Pose, SceneTruth
from tams_app.units import NS_PER_S

LIFTED_M = 0.010
ON_TABLE_M = 0.003  # above its resting height
PLACED_SPEED_M_S = 0.010
PLACED_FOR_S = 0.5
SUCCESS_WITHIN_S, MAX_DROPS = 90.0, 2  # of a successful trial: the paper's, section IV

PLACED = "the block is placed"  # begins the sentence that says so


@dataclass(frozen=True, slots=True)
class TaskGeometry:
    """The geometry that the rules need: sizes [m]."""

    container_inner: float
    container_height: float
    block_rest_height: float  # of the block's centre on the table


class TrialJudge:
    """Watches one trial and gives its verdict.

    Drop: the block was lifted by 10 mm, then lies on the table with the gripper commanded closed,
    or the gripper opened with it outside the container. One lift counts as one drop at most.
    Placed: block centre inside the container, slower than 10 mm/s for 0.5 s, gripper open.
    """

    def __init__(self, config: TrialConfig, geometry: TaskGeometry) -> None:
        self._config = config
        self._geometry = geometry
        self._started_ns: int | None = None
        self._opened_ns: int | None = None
        self._was_closed: bool | None = None
        self._lifted = False
        self._resting_since_ns: int | None = None
        self.placed = False  # the block is, once and for all
        self._limited = True
        self.drops = 0

    def engaged(self, now_ns: int) -> None:
        """The operator holds the deadman and the arm follows; the first time starts the clock."""
        if self._started_ns is None:
            self._started_ns = now_ns

    @property
    def started(self) -> bool:
        return self._started_ns is not None

    def step(
        self, now_ns: int, truth: SceneTruth, closed: bool | None, limited: bool = True
    ) -> bool:
        """Take in the scene and the gripper's last command; True once the trial has ended.

        `limited`: whether it ends, too, when its time is over, and succeeds only in time.
        """
        if self._started_ns is None or self.placed:
            return self.placed
        self._limited = limited
        inside = self.contains(truth.container, truth.block)
        self._count_drops(now_ns, truth, closed, inside)
        self.placed = self._is_placed(now_ns, truth, closed, inside)
        return self.placed or (limited and self.elapsed_s(now_ns) >= self._config.limit_s)

    def elapsed_s(self, now_ns: int) -> float:
        """Seconds since the first engagement, 0 before it."""
        return 0.0 if self._started_ns is None else (now_ns - self._started_ns) / NS_PER_S

    def outcome(self, reason: str = "") -> Outcome:
        """The verdict; `reason` says why the session ended if neither placed nor out of time."""
        if not self.placed or self._opened_ns is None or self._started_ns is None:
            return Outcome(False, False, None, self.drops, reason or "not placed in time")
        time_s = round((self._opened_ns - self._started_ns) / NS_PER_S, 3)
        completed = not self._limited or time_s <= self._config.limit_s
        quick = not self._limited or time_s <= SUCCESS_WITHIN_S
        success = completed and quick and self.drops <= MAX_DROPS
        return Outcome(completed, success, time_s, self.drops, "placed")

    def contains(self, container: Pose, block: Pose) -> bool:
        """Whether the block's centre is between the container's walls and below their edge."""
        height = float(block.position[2] - container.position[2])
        return self._is_over(container, block) and height <= self._geometry.container_height

    def _is_over(self, container: Pose, block: Pose) -> bool:
        offset = container.rotation.inv().apply(block.position - container.position)
        return bool(np.all(np.abs(offset[:2]) <= self._geometry.container_inner / 2))

    def _count_drops(
        self, now_ns: int, truth: SceneTruth, closed: bool | None, inside: bool
    ) -> None:
        height = float(truth.block.position[2]) - self._geometry.block_rest_height
        opened = self._was_closed is True and closed is False
        if closed is not None:
            self._was_closed = closed
        if opened:
            self._opened_ns = now_ns
        if height >= LIFTED_M and closed:
            self._lifted = True
        if not self._lifted:
            return
        over_container = self._is_over(truth.container, truth.block)
        fell = closed is True and height <= ON_TABLE_M and not inside
        if fell or (opened and not over_container):
            self.drops += 1
            self._lifted = False
        elif opened:
            self._lifted = False

    def _is_placed(self, now_ns: int, truth: SceneTruth, closed: bool | None, inside: bool) -> bool:
        resting = inside and closed is False and truth.block_speed < PLACED_SPEED_M_S
        if not resting:
            self._resting_since_ns = None
            return False
        if self._resting_since_ns is None:
            self._resting_since_ns = now_ns
        return (now_ns - self._resting_since_ns) >= PLACED_FOR_S * NS_PER_S

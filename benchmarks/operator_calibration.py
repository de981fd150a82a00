"""Whether the operator's stated uncertainty is right: the errors of the belief in its own sigmas.

What the operator goes by (the displacement from tool to block and to container, the block's heading
against the tool) at every glance, against what the frames then showed. With a perfectly calibrated
belief 68, 95 and 99.7 % of the errors would be within one, two and three sigmas.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from hw.sim.operator.belief import Belief
from hw.sim.operator.belief_state import BLOCK, BLOCK_YAW, CONTAINER, TOOL, TOOL_YAW
from hw.sim.operator.task import Stage
from hw.sim.operator.vision.detections import Thing
from tams_app.records import Pose, SceneTruth, Vector

SPEEDS_MM_S = ("0-5", "5-20", "20-50", "50-")  # of the tool, as asked
_BEFORE_GRASP = (Stage.REACH, Stage.TURN, Stage.DESCEND)
_HEADING_KNOWN_RAD = math.radians(12.0)
_QUARTER = math.pi / 2
_PLACES = {Thing.BLOCK: BLOCK, Thing.CONTAINER: CONTAINER}


@dataclass(frozen=True, slots=True)
class NormalisedErrors:
    """Of one glance, in sigmas: along x and y to block and container, and of the heading."""

    stage: Stage
    speed_m_s: float
    by_quantity: dict[str, list[float]]

    @property
    def speed(self) -> str:
        """One of SPEEDS_MM_S."""
        upper = [float(name.split("-")[0]) for name in SPEEDS_MM_S[1:]]
        return SPEEDS_MM_S[int(np.searchsorted(upper, 1000.0 * self.speed_m_s, side="right"))]


def normalised_errors(
    belief: Belief, stage: Stage, speed_m_s: float, shown: Sequence[SceneTruth]
) -> NormalisedErrors:
    """`shown`: what was the case in each frame on screen; compared with their mean."""
    errors: dict[str, list[float]] = {}
    if shown and belief.seen[Thing.TOOL]:
        for thing, where in _PLACES.items():
            if belief.seen[thing]:
                ways = [_pose(one, thing).position - one.tcp.position for one in shown]
                errors[thing.value] = _way_errors(belief, where, np.mean(ways, axis=0))
        if stage in _BEFORE_GRASP and belief.seen[Thing.BLOCK] and not belief.lies:
            errors["heading"] = _heading_errors(belief, shown[-1])
    return NormalisedErrors(stage, speed_m_s, errors)


def _way_errors(belief: Belief, where: slice, true: Vector) -> list[float]:
    errors = []
    for axis in (0, 1):
        place, tool = where.start + axis, TOOL.start + axis
        error = belief.state[place] - belief.state[tool] - true[axis]
        errors.append(float(error) / math.sqrt(_variance(belief, place, tool)))
    return errors


def _heading_errors(belief: Belief, shown: SceneTruth) -> list[float]:
    """Empty before the heading has been made out at all."""
    variance = _variance(belief, BLOCK_YAW, TOOL_YAW)
    if variance > _HEADING_KNOWN_RAD**2:
        return []
    true = _yaw(shown.block) - _yaw(shown.tcp)
    error = belief.block_yaw - belief.tool_yaw - true
    return [((error + _QUARTER / 2) % _QUARTER - _QUARTER / 2) / math.sqrt(variance)]


def _variance(belief: Belief, place: int, against: int) -> float:
    covariance = belief.covariance
    sum_ = covariance[place, place] + covariance[against, against]
    return float(sum_ - 2.0 * covariance[place, against])


def _pose(truth: SceneTruth, thing: Thing) -> Pose:
    return truth.block if thing is Thing.BLOCK else truth.container


def _yaw(pose: Pose) -> float:
    x_axis = pose.rotation.as_matrix()[:, 0]
    return math.atan2(x_axis[1], x_axis[0])


@dataclass(frozen=True, slots=True)
class Within:
    """How many errors there are, and the shares of them within one, two and three sigmas."""

    n: int
    one: float
    two: float
    three: float

    @staticmethod
    def of(errors: Sequence[float]) -> Within:
        size = np.abs(np.asarray(errors, float))
        one, two, three = (round(float(np.mean(size < limit)), 4) for limit in (1.0, 2.0, 3.0))
        return Within(len(size), one, two, three)


def calibration(glances: Sequence[NormalisedErrors]) -> dict[str, dict[str, dict[str, float]]]:
    """`Within` by quantity, and there of all glances, by stage and by speed [mm/s]."""
    groups: dict[str, dict[str, list[float]]] = {}
    for glance in glances:
        for quantity, errors in glance.by_quantity.items():
            of = groups.setdefault(quantity, {})
            for group in ("all", glance.stage.value, f"{glance.speed} mm/s"):
                of.setdefault(group, []).extend(errors)
    return {
        quantity: {group: asdict(Within.of(errors)) for group, errors in of.items() if errors}
        for quantity, of in groups.items()
    }

"""True phases of a simulated trial from what its log holds: ticks and where things were."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.phases.labels import DEFAULT_RULES, Geometry, LabelRules, geometric_labels
from calibration.phases.trials import NOT_COUNTED, Codes, Floats
from tams_app.errors import LogError
from tams_app.records import SceneTruth, Tick, Vector
from tams_app.study.trial import TaskGeometry
from tams_app.teleop.safety import ArmingState


def true_labels(
    name: str,
    ticks: Sequence[Tick],
    scene: Sequence[SceneTruth],
    sizes: TaskGeometry,
    rules: LabelRules = DEFAULT_RULES,
) -> Codes:
    """The phase of every tick by geometry, shape (n,); what precedes the trial is not counted.

    The trial's clock starts at the first engagement, as its rules say. LogError if there was none,
    or nothing tells where things were.
    """
    labels = np.full(len(ticks), NOT_COUNTED, np.int8)
    start = _first_engaged(ticks)
    if start is None or not scene:
        missing = "an engagement of the arm" if scene else "where the block was"
        raise LogError(f"{name}: has no record of {missing}: its phases cannot be told from it")
    labels[start:] = geometric_labels(_geometry(ticks[start:], scene, sizes), rules)
    return labels


def _first_engaged(ticks: Sequence[Tick]) -> int | None:
    """The first tick in which the arm followed the hand, its state known."""
    for place, tick in enumerate(ticks):
        if tick.arm is not None and tick.deadman and tick.arming == ArmingState.ENGAGED.value:
            return place
    return None


def _geometry(ticks: Sequence[Tick], scene: Sequence[SceneTruth], sizes: TaskGeometry) -> Geometry:
    """All at the times of the ticks; an arm that says nothing stays where it was."""
    t_ns = np.array([tick.started_ns for tick in ticks])
    scene_ns = np.array([truth.t_ns for truth in scene])
    block = _at(t_ns, scene_ns, np.array([truth.block.position for truth in scene]))
    container = scene[0].container  # it stands fast
    beside = container.rotation.inv().apply(block - container.position)
    over = np.abs(beside[:, :2]).max(axis=1) <= sizes.container_inner / 2
    tool: list[Vector] = []
    closed: list[bool] = []
    for tick in ticks:
        arm = tick.arm
        tool.append(arm.tcp.position if arm is not None else tool[-1])
        said = arm.gripper_closed if arm is not None else None
        before = closed[-1] if closed else False  # unknown counts as open, as in Algorithm 1
        closed.append(before if said is None else said)
    return Geometry(np.array(tool), block, over, np.array(closed), sizes.block_rest_height)


def _at(t_ns: Floats, scene_ns: Floats, position: Floats) -> Floats:
    """Positions [m], shape (n, 3), between the times at which they are known."""
    columns = [np.interp(t_ns, scene_ns, position[:, axis]) for axis in range(3)]
    return np.stack(columns, axis=1)

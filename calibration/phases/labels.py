"""Trials with their true phases: recorded or made in virtual time, marked or labelled by geometry.

The geometry is of tool, block and container, and of the gripper's command. It is independent of
Algorithm 1: no speed and no dwell time occurs in it, and it looks ahead (what was reaching and what
was aligning shows when the gripper closes). docs/calibration/phases.md has the definition in words
and says what in it is a judgement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.kit import Progress
from calibration.phases.fit import CODE, NOT_COUNTED, Codes, Floats, Trial, motion_of, stretches
from tams_app.config import Config
from tams_app.console.replay.marks import FILE_NAME, Mark, read_marks
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, SetupError, UnreadableLogError
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Phase, SceneTruth, Tick, Vector
from tams_app.robot.trial import task_geometry
from tams_app.task.judge import TaskGeometry
from tams_app.teleop.safety import ArmingState

Flags: TypeAlias = NDArray[np.bool_]


# the distances of the definition
_OVER_BLOCK_M = 0.020  # from tool to block, horizontally
_LIFTED_M = 0.003  # above its rest: then the block has left the table (as in a trial)
_HELD_M = 0.030  # from tool to block, at most, while it is carried
_AWAY_M = 0.010  # half the block's height: then the fingertips are clear of it


@dataclass(frozen=True, slots=True)
class Geometry:
    """A trial over n ticks in the arm's base frame, z = 0 on the table.

    `tool`, `block`: centres [m], shape (n, 3). `over_container`: the block is between the
    container's walls, seen from above, shape (n,). `closed`: the gripper's last acknowledged
    command, shape (n,). `block_rest_height`: of its centre on the table [m].
    """

    tool: Floats
    block: Floats
    over_container: Flags
    closed: Flags
    block_rest_height: float


def geometric_labels(scene: Geometry) -> Codes:
    """The true phase of every tick, NOT_COUNTED where the task knows none, shape (n,)."""
    labels = np.full(len(scene.closed), NOT_COUNTED, np.int8)
    for start, stop in stretches(scene.closed):
        part = slice(start, stop)
        if scene.closed[start]:
            _label_closed(labels[part], _cut(scene, part))
        else:
            _label_open(labels[part], _cut(scene, part), start > 0, stop < len(labels))
    return labels


def _label_closed(labels: Codes, scene: Geometry) -> None:
    """Grasp until the block leaves the table or the tool has gone, then what carries it."""
    gap = np.linalg.norm(scene.tool - scene.block, axis=1)
    holds = gap <= _HELD_M
    off_table = holds & (scene.block[:, 2] - scene.block_rest_height >= _LIFTED_M)
    lifted = _first(off_table)
    gone = _first(_moved(scene.tool) > _AWAY_M)
    labels[: min(lifted, gone)] = CODE[Phase.GRASP]
    carried = holds & (np.arange(len(labels)) >= lifted)
    labels[carried] = CODE[Phase.TRANSPORT]
    labels[_tail(carried & scene.over_container)] = CODE[Phase.PRE_RELEASE]


def _label_open(labels: Codes, scene: Geometry, opened: bool, closes: bool) -> None:
    """Release until the tool has gone, then reach, and align from when it is over the block."""
    labels[:] = CODE[Phase.REACH]
    sideways = np.linalg.norm((scene.tool - scene.block)[:, :2], axis=1)
    over = sideways <= _OVER_BLOCK_M
    if closes or not scene.over_container[-1]:  # a trial may end before the gripper closes
        labels[_tail(over)] = CODE[Phase.ALIGN]
    if opened:
        gone = _first(_moved(scene.tool) > _AWAY_M)
        held_something = np.linalg.norm(scene.tool[0] - scene.block[0]) <= _HELD_M
        labels[:gone] = CODE[Phase.RELEASE] if held_something else NOT_COUNTED


def _moved(tool: Floats) -> Floats:
    """How far from its first place [m], shape (n,)."""
    distance: Floats = np.linalg.norm(tool - tool[0], axis=1)
    return distance


def _first(flags: Flags) -> int:
    """The index of the first true, their number if there is none."""
    return int(np.argmax(flags)) if flags.any() else len(flags)


def _tail(flags: Flags) -> slice:
    """The longest end of which all are true."""
    false = np.flatnonzero(~flags)
    return slice(int(false[-1]) + 1 if len(false) else 0, len(flags))


def _cut(scene: Geometry, part: slice) -> Geometry:
    return Geometry(
        scene.tool[part],
        scene.block[part],
        scene.over_container[part],
        scene.closed[part],
        scene.block_rest_height,
    )


def true_labels(
    name: str, ticks: Sequence[Tick], scene: Sequence[SceneTruth], sizes: TaskGeometry
) -> Codes:
    """The phase of every tick by geometry, shape (n,); what precedes the trial is not counted.

    The trial's clock starts at the first engagement, as its rules say. LogError if there was none,
    or nothing shows where things were.
    """
    labels = np.full(len(ticks), NOT_COUNTED, np.int8)
    engaged = (
        place
        for place, tick in enumerate(ticks)
        if tick.arm is not None and tick.deadman and tick.arming == ArmingState.ENGAGED.value
    )
    start = next(engaged, None)
    if start is None or not scene:
        missing = "an engagement of the arm" if scene else "where the block was"
        raise UnreadableLogError(
            f"{name}: has no record of {missing}: its phases cannot be told from it"
        )
    labels[start:] = geometric_labels(_geometry(ticks[start:], scene, sizes))
    return labels


def marked_labels(marks: Sequence[Mark], t_s: Floats) -> Codes:
    """The marked phase of every tick, shape (n,)."""
    codes = [NOT_COUNTED, *(NOT_COUNTED if m.phase is None else CODE[m.phase] for m in marks)]
    place = np.searchsorted([mark.t_s for mark in marks], t_s, side="right")
    return np.array(codes, np.int8)[place]


def _geometry(ticks: Sequence[Tick], scene: Sequence[SceneTruth], sizes: TaskGeometry) -> Geometry:
    """All at the times of the ticks; an arm that reports nothing stays where it was."""
    t_ns = np.array([tick.started_ns for tick in ticks])
    scene_ns = np.array([truth.t_ns for truth in scene])
    known = np.array([truth.block.position for truth in scene])
    block = np.stack([np.interp(t_ns, scene_ns, column) for column in known.T], axis=1)
    container = scene[0].container  # it stands fast
    beside = container.rotation.inv().apply(block - container.position)
    over = np.abs(beside[:, :2]).max(axis=1) <= sizes.container_inner / 2
    tool: list[Vector] = []
    closed: list[bool] = []
    for tick in ticks:
        arm = tick.arm
        tool.append(arm.tcp.position if arm is not None else tool[-1])
        reported = arm.gripper_closed if arm is not None else None
        before = closed[-1] if closed else False  # unknown counts as open, as in Algorithm 1
        closed.append(before if reported is None else reported)
    return Geometry(np.array(tool), block, over, np.array(closed), sizes.block_rest_height)


_MARKED = " (marked)"
_USUAL_S = 30.0  # of a trial; for the progress only


@dataclass(frozen=True, slots=True)
class Material:
    """Trials to learn from, those held out to judge by, and where they are from."""

    trials: list[Trial]
    held_out: list[Trial]
    source: str  # in words
    simulated: bool


def logged_trials(folders: Sequence[Path], smoothing_ms: float, progress: Progress) -> Material:
    """The trials of recorded sessions: by the marks beside each log, else by where things were.

    ConfigError for a folder that has neither, and for a copy of another, or itself again.
    """
    folders = [session_log(folder).parent for folder in folders]
    trials, names, simulated = [], [], False
    for number, folder in enumerate(folders):
        progress(f"reading {folder.name}", number / len(folders))
        log, marked = read_log(folder / LOG_NAME), (folder / FILE_NAME).is_file()
        trials.append(_logged_trial(folder, log, smoothing_ms))
        names.append(folder.name + (_MARKED if marked else ""))
        simulated |= bool(log.scene) or bool(log.header.config.get("rig", {}).get("enabled"))
    for (one, a), (other, b) in combinations(zip(folders, trials, strict=True), 2):
        if a.motion.inputs == b.motion.inputs:
            raise ConfigError(f"{other}: is a copy of {one}: a trial left out must be unseen")
    return Material(trials, [], f"recorded trials: {', '.join(names)}", simulated)


def virtual_trials(
    config: Config, seeds: Sequence[int], unseen: int, progress: Progress
) -> Material:
    """One trial for each seed of scene and participant, made now, the last `unseen` held out.

    SetupError without MuJoCo.
    """
    if find_spec("mujoco") is None:
        raise SetupError("simulated trials need MuJoCo: pip install mujoco")
    from tams_app.session.virtual.videoless import VideolessTrial  # logs are read without MuJoCo

    smoothing_ms = config.policy.phases.smoothing_ms
    trials = []
    for number, seed in enumerate(seeds):
        made = VideolessTrial(config, seed)
        for elapsed_s in made.perform():
            done = (number + min(elapsed_s / _USUAL_S, 1.0)) / len(seeds)
            progress(f"trial {number + 1} of {len(seeds)} in virtual time", done)
        name = f"seed {seed}"
        motion = motion_of(name, made.ticks, made.ticks[0].started_ns, smoothing_ms)
        labels = true_labels(name, made.ticks, made.scene, task_geometry())
        trials.append(Trial(motion, labels))
    known = len(seeds) - unseen
    source = f"simulated trials, seed {seeds[0]} to seed {seeds[known - 1]}"
    return Material(trials[:known], trials[known:], source, True)


def _logged_trial(folder: Path, log: SessionLog, smoothing_ms: float) -> Trial:
    name = folder.name
    motion = motion_of(name, log.ticks, log.header.started_ns, smoothing_ms)
    marks = folder / FILE_NAME
    if marks.is_file():
        return Trial(motion, marked_labels(read_marks(marks, motion.last_s), motion.t_s))
    if not log.scene:
        raise ConfigError(
            f"{folder}: its phases are not known: mark them with "
            f"`run_tams.py replay {folder} --mark`"
        )
    return Trial(motion, true_labels(name, log.ticks, log.scene, task_geometry()))

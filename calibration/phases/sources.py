"""Where labelled trials come from: recorded logs, or trials made in virtual time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path

from calibration.phases.fit import Progress
from calibration.phases.labels import marked_labels, true_labels
from calibration.phases.trials import Trial, motion_of
from tams_app.config import Config
from tams_app.console.replay.marks import FILE_NAME, read_marks
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, SetupError
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.robot.build import task_geometry

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

    ConfigError for a folder that has neither, and for one that is given twice, or a copy of it.
    """
    for number, folder in enumerate(folders):
        if folder.resolve() in [other.resolve() for other in folders[:number]]:
            raise ConfigError(f"{folder}: is given twice: a trial left out must be unseen")
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

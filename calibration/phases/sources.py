"""Where labelled trials come from: recorded logs, or trials made in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

from calibration.phases.labels import LabelRules
from calibration.phases.marks import FILE_NAME, labels_from, read_marks
from calibration.phases.strip import Replay, replay_of
from calibration.phases.trials import Trial, motion_of
from calibration.phases.truth import true_labels
from calibration.phases.virtual_trial import VirtualTrial
from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.recording import SessionLog, read_log
from tams_app.session.build import task_geometry
from tams_app.session.recorders import LOG_NAME

Progress: TypeAlias = Callable[[str, float], None]  # what is under way, and the part of it done
_USUAL_S = 30.0  # of a trial; for the progress only


def logged_trials(
    folders: Sequence[Path], smoothing_ms: float, rules: LabelRules, progress: Progress
) -> list[Trial]:
    """The trials of recorded sessions: by the marks beside each log, else by where things were.

    ConfigError for a folder that is given twice or has neither.
    """
    check_folders(folders)
    trials = []
    for number, folder in enumerate(folders):
        progress(f"reading {folder.name}", number / len(folders))
        trials.append(_logged_trial(folder, smoothing_ms, rules))
    return trials


def logged_replay(folder: Path, smoothing_ms: float) -> Replay:
    """A recorded session for marking."""
    log = _read(folder)
    motion = motion_of(folder.name, log.ticks, log.header.started_ns, smoothing_ms)
    return replay_of(motion, log.ticks)


def virtual_trials(
    config: Config, seeds: Sequence[int], rules: LabelRules, progress: Progress
) -> list[Trial]:
    """One trial for each seed of scene and participant, made now."""
    trials = []
    for number, seed in enumerate(seeds):
        trial = VirtualTrial(config, seed)
        for elapsed_s in trial.perform():
            done = (number + min(elapsed_s / _USUAL_S, 1.0)) / len(seeds)
            progress(f"trial {number + 1} of {len(seeds)} in virtual time", done)
        performed = trial.performed()
        name = f"seed {seed}"
        started_ns = performed.ticks[0].started_ns
        smoothing_ms = config.policy.phases.smoothing_ms
        motion = motion_of(name, performed.ticks, started_ns, smoothing_ms)
        labels = true_labels(name, performed.ticks, performed.scene, task_geometry(), rules)
        trials.append(Trial(motion, labels))
    return trials


def check_folders(folders: Sequence[Path]) -> None:
    """ConfigError if one is given twice: it would be left out and learned from at once."""
    seen: set[Path] = set()
    for folder in folders:
        if folder.resolve() in seen:
            raise ConfigError(f"{folder}: is given twice: a trial left out must be unseen")
        seen.add(folder.resolve())


def _logged_trial(folder: Path, smoothing_ms: float, rules: LabelRules) -> Trial:
    log = _read(folder)
    name = folder.name
    motion = motion_of(name, log.ticks, log.header.started_ns, smoothing_ms)
    marks = folder / FILE_NAME
    if marks.is_file():
        return Trial(motion, labels_from(read_marks(marks, float(motion.t_s[-1])), motion.t_s))
    if not log.scene:
        raise ConfigError(
            f"{folder}: nobody knows its phases: mark them with "
            f"`run_tams.py calibrate phases --from {folder} --mark`"
        )
    return Trial(motion, true_labels(name, log.ticks, log.scene, task_geometry(), rules))


def _read(folder: Path) -> SessionLog:
    path = folder / LOG_NAME
    if not path.is_file():
        raise ConfigError(f"{folder}: is no session folder: there is no {LOG_NAME} in it")
    return read_log(path)

"""`run_tams.py calibrate phases`: from trials with known phases to Algorithm 1's thresholds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from rich.progress_bar import ProgressBar
from rich.table import Table

from calibration.desk import Desk
from calibration.phases import report
from calibration.phases.fit import (
    LEAST_TRIALS,
    SEARCHED,
    PhaseFit,
    check_count,
    evaluate,
    fit_thresholds,
    sensitivity,
)
from calibration.phases.labels import LabelRules
from calibration.phases.marking import mark_trial
from calibration.phases.marks import FILE_NAME
from calibration.phases.picture import save_sensitivity
from calibration.phases.scores import Scores
from calibration.phases.sources import (
    LoggedTrial,
    check_folders,
    logged_replay,
    logged_trials,
    virtual_trials,
)
from calibration.phases.trials import Trial
from calibration.store import Calibration, CalibrationSet, utc_now
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError

KIND = "phases"
_DEFAULT_TRIALS = 10

_INTRODUCTION = """\
Algorithm 1 tells the phases of the task from the arm's speed and the gripper. When a tool counts
as still, when as descending, and for how long, depends on the setup: here the four thresholds are
sought with which it agrees best with trials whose phases are known. Ctrl-C ends this at any time,
and nothing is changed."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line asked for; `goal_height_mm` None: at any height."""

    logs: tuple[Path, ...] = ()
    sim: bool = False
    trials: int | None = None
    held_out: int | None = None
    seed: int = 0
    goal_height_mm: float | None = None
    mark: bool = False
    picture: Path | None = None
    yes: bool = False

    @property
    def learn_from(self) -> int:
        """How many simulated trials."""
        return _DEFAULT_TRIALS if self.trials is None else self.trials


def run_phases(
    desk: Desk,
    config_path: Path | None,
    options: Options,
    now: Callable[[], datetime] = utc_now,
) -> int:
    """The whole conversation; the exit code. ConfigError for options that exclude each other."""
    _check(options)
    config = load_config(config_path)
    kept = CalibrationSet.of(config_path, config, now)
    with desk:
        if options.mark:
            return _mark(desk, options.logs, config)
        kept.check_before(desk, options.yes, options.sim)
        desk.say(_INTRODUCTION)
        material = _material(desk, config, options)
        kept.check_before(desk, options.yes, material.simulated)
        found = fit_thresholds(material.trials, config.policy.phases.smoothing_ms, _shown(desk))
        unseen = _held_out_scores(material.held_out, found)
        _tell(desk, found, unseen)
        curves = sensitivity(material.trials, found.thresholds, _shown(desk))
        if options.picture is not None:
            save_sensitivity(curves, options.picture)
            desk.say(f"Sensitivity around the optimum: {options.picture}")
        picture = f"{KIND}-{now().strftime('%Y%m%dT%H%M%SZ')}-sensitivity.png"
        calibration = Calibration(
            KIND,
            {"policy": {"phases": {name: getattr(found.thresholds, name) for name in SEARCHED}}},
            material.source,
            report.quality(found, unseen) | {"picture": picture},
            simulated=material.simulated,
        )
        somebody_decides = desk.attended
        written = kept.propose(
            desk, calibration, options.yes, lambda: save_sensitivity(curves, kept.folder / picture)
        )
        return 0 if written or somebody_decides else 1


def _check(options: Options) -> None:
    if options.sim == bool(options.logs):
        raise ConfigError("say where the trials come from: --sim, or --from LOG (repeatable)")
    if options.mark and options.sim:
        raise ConfigError("--mark is for recorded logs: simulated trials know their phases")
    if not options.sim and (options.trials is not None or options.held_out is not None):
        raise ConfigError("--trials and --held-out are for --sim: logs are given with --from")
    if options.seed < 0 or (options.held_out or 0) < 0:
        raise ConfigError("--seed and --held-out cannot be below 0")
    if options.goal_height_mm is not None and not options.goal_height_mm > 0:
        raise ConfigError("--goal-height-mm must be more than 0")
    if options.picture is not None and not options.picture.parent.is_dir():
        raise ConfigError(f"--picture: there is no folder {options.picture.parent}")
    if options.picture is not None and options.picture.is_dir():
        raise ConfigError(f"--picture: {options.picture} is a folder, not a file")
    given = len(options.logs) if options.logs else options.learn_from
    if not options.mark:
        check_count(given)


def _mark(desk: Desk, folders: Sequence[Path], config: Config) -> int:
    """Marks for each log in turn."""
    check_folders(folders)
    if not desk.attended:
        raise ConfigError("--mark asks a person for the phases: start it from a terminal")
    for folder in folders:
        replay = logged_replay(folder, config.policy.phases.smoothing_ms)
        marks = mark_trial(desk, replay, folder / FILE_NAME)
        desk.say(f"{folder / FILE_NAME}: {len(marks)} marks")
    desk.say(f"Once at least {LEAST_TRIALS} trials are marked, give them all without --mark.")
    return 0


@dataclass(frozen=True, slots=True)
class _Material:
    """Trials to learn from, those to judge by that nobody learns from, and whence they are."""

    trials: list[Trial]
    held_out: list[Trial]
    source: str
    simulated: bool


def _material(desk: Desk, config: Config, options: Options) -> _Material:
    height_mm = options.goal_height_mm
    rules = LabelRules() if height_mm is None else LabelRules(goal_height=height_mm / 1000)
    rule = "" if height_mm is None else f"; align and pre-release only below {height_mm:g} mm"
    shown = _shown(desk)
    if options.logs:
        smoothing_ms = config.policy.phases.smoothing_ms
        logged = logged_trials(options.logs, smoothing_ms, rules, shown)
        rule = "" if all(log.marked for log in logged) else rule  # marks know no height
        trials = [log.trial for log in logged]
        source = f"recorded trials: {', '.join(map(_name, logged))}{rule}"
        return _Material(trials, [], source, any(log.simulated for log in logged))
    count = options.learn_from
    unseen = count if options.held_out is None else options.held_out
    seeds = range(options.seed, options.seed + count + unseen)
    desk.say(f"{count} simulated trials to learn from, {unseen} held out; a few seconds each.")
    trials = virtual_trials(config, seeds, rules, shown)
    source = f"simulated trials, {trials[0].name} to {trials[count - 1].name}{rule}"
    return _Material(trials[:count], trials[count:], source, True)


def _name(log: LoggedTrial) -> str:
    return f"{log.trial.name} (marked)" if log.marked else log.trial.name


def _held_out_scores(held_out: Sequence[Trial], found: PhaseFit) -> tuple[Scores, Scores] | None:
    if not held_out:
        return None
    defaults = type(found.thresholds)()
    return evaluate(held_out, found.thresholds), evaluate(held_out, defaults)


def _tell(desk: Desk, found: PhaseFit, unseen: tuple[Scores, Scores] | None) -> None:
    desk.say(
        report.as_text(
            "",
            report.thresholds_table(found),
            "",
            report.accuracy_table(found, unseen),
            "\nEach trial with the thresholds that the others give, in control ticks:",
            report.confusion_table(found.left_out),
            "",
            report.switches_table(found.left_out),
            "\nThe same trials with the defaults, the paper's Algorithm 1 as configured:",
            report.confusion_table(found.defaults),
        )
    )
    for remark in report.remarks(found):
        desk.say(f"\nNote: {remark}")


def _shown(desk: Desk) -> Callable[[str, float], None]:
    """Progress in the desk's live area."""

    def show(doing: str, part: float) -> None:
        row = Table.grid(padding=(0, 1))
        row.add_row(doing, ProgressBar(total=1.0, completed=part, width=40), f"{part:.0%}")
        desk.show(row)

    return show

"""The study's commands, from options to exit codes; what they need besides is imported here."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tams_app.config import Config
from tams_app.errors import ConfigError, SetupError
from tams_app.questions import Questions
from tams_app.recording import read_log
from tams_app.study.completion_time import completion_time_s
from tams_app.study.folder import StudyFolder
from tams_app.study.guided import GuidedRun
from tams_app.study.local_pool import LocalPool, TrialPool
from tams_app.study.plan import ParticipantState, Plan, void
from tams_app.study.planning import balance_sentence, make_plan
from tams_app.study.runner import TrialRunner
from tams_app.study.unattended import RichProgress, run_unattended

LOG_NAME = "session.mcap"
_REPORT_NEEDS = ("pandas", "pyarrow", "statsmodels")


def plan_study(config: Config, folder: Path, participants: int, console: Console) -> int:
    """`study plan`: write the plan of a new study and say what it holds."""
    study = StudyFolder(folder)
    study.create(make_plan(config, participants), config)
    return show_study(folder, console)


def ensure_planned(config: Config, folder: Path, participants: int | None) -> StudyFolder:
    """The study in `folder`, planned now if there is none.

    ConfigError where `participants` is missing for a new one, or is not that of the old one.
    """
    study = StudyFolder(folder)
    if not study.exists:
        if participants is None:
            raise ConfigError(f"{folder}: holds no study: say how many with --participants")
        study.create(make_plan(config, participants), config)
        return study
    planned = study.load()
    if participants not in (None, len(planned.participants)):
        raise ConfigError(
            f"{folder}: is planned for {len(planned.participants)} participants, not "
            f"{participants}: leave --participants out, or choose another folder"
        )
    asked = make_plan(config, len(planned.participants))
    if participants is not None and _design(asked) != _design(planned):
        raise ConfigError(
            f"{folder}: was planned with other strategies, networks, repetitions or seed: leave "
            "the options out to go on with it, or choose another folder"
        )
    return study


def run_simulated(
    study: StudyFolder,
    runner: TrialRunner,
    console: Console,
    workers: int | None = None,
    dask: str | None = None,
) -> int:
    """`study run` on simulated trials: 0 if all there were to run are done, else 1."""
    with study.locked():
        plan = study.recover(study.load())
        if not plan.simulated:
            raise ConfigError(f"{study.path}: is planned for people on hardware: leave out --sim")
        if not plan.left:
            console.print("All trials of this study are done.")
            return 0
        pool = _pool(runner, workers, dask)
        try:
            with RichProgress(console, len(plan.left)) as display:
                tally = run_unattended(study, pool, display)
        except KeyboardInterrupt:
            _tell_how_to_go_on(study, console)
            raise
    failed = len(tally.failures)
    console.print(f"{tally.done} trials done, {failed} failed.", highlight=False)
    if failed:
        console.print("The next `study run` tries those again.", highlight=False)
    return 1 if failed else 0


def run_guided(
    study: StudyFolder,
    runner: TrialRunner,
    participant: str | None,
    questions: Questions,
) -> int:
    """`study run` on hardware: one sitting with one participant."""
    with study.locked():
        if study.load().simulated:
            raise ConfigError(f"{study.path}: is planned for the simulated rig: add --sim")
        GuidedRun(study, runner, questions, measured_time_s).run(participant)
    return 0


def measured_time_s(folder: Path) -> float | None:
    """The completion time that a trial's log tells, None without a log."""
    path = folder / LOG_NAME
    return completion_time_s(read_log(path)) if path.is_file() else None


def void_trial(folder: Path, trial_id: str, reason: str, console: Console) -> int:
    """`study void`: the trial's last attempt does not count; its data and the reason stay."""
    study = StudyFolder(folder)
    with _existing(study).locked():
        study.save(void(study.recover(study.load()), trial_id, reason))
    console.print(f"{trial_id} is void and will be taken again.", highlight=False)
    return 0


def forget_participant(folder: Path, pseudonym: str, console: Console) -> int:
    """`study forget`: delete a participant's data; says what remains."""
    study = StudyFolder(folder)
    with _existing(study).locked():
        plan = study.recover(study.load())
        removed = [one for one in plan.trials if one.participant == pseudonym and one.attempts]
        plan = study.forget(plan, pseudonym)
    remaining = sum(trial.is_done for trial in plan.trials)
    console.print(
        f"{pseudonym} is forgotten: {len(removed)} trials with all their attempts, the tables and "
        f"the report are deleted. What remains: {remaining} finished trials of the others, and in "
        f"the plan that {pseudonym} took part and is forgotten. Copies made elsewhere, and reports "
        "written with --out, are yours to delete. `study report` makes the report anew.",
        highlight=False,
        soft_wrap=True,
    )
    return 0


def show_study(folder: Path, console: Console) -> int:
    """`study show`: how far each participant is, and what failed or is void."""
    plan = StudyFolder(folder).load()
    whose = "simulated operators" if plan.simulated else "people at the hardware"
    title = f"{plan.name}: {len(plan.trials)} trials, {whose}"
    table = Table(title=title, title_justify="left")
    for heading in ("participant", "done", "planned", "void or failed attempts", "next"):
        table.add_column(heading)
    for person in plan.participants:
        table.add_row(*_progress_of(plan, person.id, person.state))
    console.print(table)
    console.print(balance_sentence(plan), highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)
    return 0


def report_study(
    folder: Path, console: Console, out: Path | None = None, tolerance_ssim: float | None = None
) -> int:
    """`study report`: tables, figures, HTML and PDF. SetupError without the extra `study`."""
    missing = [name for name in _REPORT_NEEDS if find_spec(name) is None]
    if missing:
        raise SetupError(f"{', '.join(missing)} missing: pip install 'tams[study]'")
    from tams_app.study.report.build import write_report

    written = write_report(StudyFolder(folder), out, tolerance_ssim)
    for path in (written.html, written.pdf, *written.tables):
        console.print(f"[bold]{path}[/]", highlight=False)
    return 0


def _tell_how_to_go_on(study: StudyFolder, console: Console) -> None:
    trials = study.load().trials
    done = sum(trial.is_done for trial in trials)
    console.print(
        f"Stopped: {done} of {len(trials)} trials are done and kept. "
        f"`study run --sim {study.path}` goes on with the others.",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )


def _existing(study: StudyFolder) -> StudyFolder:
    study.load()
    return study


def _pool(runner: TrialRunner, workers: int | None, dask: str | None) -> TrialPool:
    if dask is None:
        return LocalPool(runner, workers)
    from tams_app.study.dask_pool import DaskPool

    return DaskPool(runner, dask)


def _design(plan: Plan) -> tuple[object, ...]:
    return (
        plan.simulated,
        plan.seed,
        plan.strategies,
        plan.networks,
        plan.repetitions,
        plan.reference,
        plan.proposed,
    )


def _progress_of(plan: Plan, pseudonym: str, state: ParticipantState) -> tuple[str, ...]:
    mine = [trial for trial in plan.trials if trial.participant == pseudonym]
    if state is not ParticipantState.TAKES_PART:
        return (pseudonym, state.value, "", "", "")
    done = [trial for trial in mine if trial.is_done]
    others = sum(len(trial.attempts) for trial in mine) - len(done)
    following = next((trial.id for trial in mine if not trial.is_done), "")
    return (pseudonym, str(len(done)), str(len(mine) - len(done)), str(others), following)

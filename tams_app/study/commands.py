"""The study's commands, from options to exit codes; what they need besides is imported here."""

from __future__ import annotations

import json
import sys
from operator import attrgetter
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.prompt import Confirm
from rich.table import Table

from tams_app.config import DEFAULT_CONFIG, Config, load_config
from tams_app.errors import ConfigError, require_extra
from tams_app.outputs import inner_folder
from tams_app.printing import Console, waiting
from tams_app.study.folder import REPORT_NAME, TABLES_NAME, StudyFolder
from tams_app.study.guided import GuidedRun
from tams_app.study.plan import Participant, ParticipantState, Plan, conditions_of_all, void
from tams_app.study.planning import balance_sentence, make_plan
from tams_app.study.runner import TrialRunner
from tams_app.study.trial_process import DaskPool, LocalPool
from tams_app.study.unattended import TrialsProgress, run_unattended

REMARKS_NAME = "remarks.txt"
REMARKS_BYTES = 100_000
_DESIGN = {  # what a plan fixes: the option of each key of the configuration
    "study.repetitions": "--repetitions",
    "study.practice_trials": "--practice",
    "seed": "--seed",
}


def plan_study(config: Config, folder: Path, participants: int, console: Console) -> int:
    """`study plan`: write the plan of a new study and say what it holds."""
    study = StudyFolder(folder)
    study.create(make_plan(config, participants), config)
    return show_study(folder, console)


def study_to_run(
    folder: Path,
    sim: bool,
    participants: int | None,
    options: dict[str, Any],
    path: Path | None = None,
) -> StudyFolder:
    """The study in `folder`, planned now if there is none.

    ConfigError where another one was planned there. `path`: of a configuration file; `options`: by
    key of the configuration, None where they were not given.
    """
    study = StudyFolder(folder)
    if not study.exists:
        settings = load_config(path, options)
        if participants is None:
            raise ConfigError(f"{folder}: holds no study: say how many with --participants")
        if settings.rig.enabled and not sim:
            raise ConfigError(
                f"{path or DEFAULT_CONFIG}: describes the simulated rig: add --sim, or give the "
                "hardware's configuration with --config"
            )
        study.create(make_plan(settings, participants), settings)
        return study
    planned = study.config()
    for key, option in _DESIGN.items():
        before = attrgetter(key)(planned)
        if options[key] not in (None, before):
            raise ConfigError(
                f"{folder}: was planned with {option} {before}, not {options[key]}: leave it out "
                "to go on, or choose another folder with --out"
            )
    # what a study overrides may differ
    if path and conditions_of_all(load_config(path, options)) != conditions_of_all(planned):
        raise ConfigError(
            f"{folder}: was planned with another configuration than {path} is now: leave "
            "--config out to go on, or choose another folder with --out"
        )
    count = len(study.load().participants)
    if participants not in (None, count):
        raise ConfigError(
            f"{folder}: is planned for {count} participants, not {participants}: leave "
            "--participants out, or choose another folder"
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
    with study.opened() as plan:
        if not plan.simulated:
            raise ConfigError(f"{study.path}: is planned for people on hardware: leave out --sim")
        if not plan.left:
            console.print("All trials of this study are done.")
            return 0
        pool: LocalPool | DaskPool = (
            LocalPool(runner, workers) if dask is None else DaskPool(runner, dask)
        )
        try:
            with TrialsProgress(console, len(plan.left), pool.slots) as display:
                failed = len(run_unattended(study, pool, display))
        except KeyboardInterrupt:
            _show_how_to_go_on(study, console)
            raise
    console.print(f"{len(plan.left) - failed} trials done, {failed} failed.")
    if failed:
        console.print("The next `study run` tries those again.")
    return 1 if failed else 0


def run_guided(
    study: StudyFolder, runner: TrialRunner, participant: str | None, console: Console
) -> int:
    """`study run` on hardware: one sitting with one participant; 1 if a trial could not be run."""
    with study.locked():
        if study.load().simulated:
            raise ConfigError(f"{study.path}: is planned for the simulated rig: add --sim")
        guided = GuidedRun(study, runner, console)
        guided.run(participant)
    return int(guided.failed)


def void_trial(folder: Path, trial_id: str, reason: str, console: Console) -> int:
    """`study void`: the trial's last attempt does not count; its data and the reason stay."""
    study = StudyFolder(folder)
    with study.opened() as plan:
        study.save(void(plan, trial_id, reason))
    console.print(f"{trial_id} is void and will be taken again.")
    return 0


def forget_participant(folder: Path, pseudonym: str, console: Console, yes: bool) -> int:
    """`study forget`: delete a participant's data; says what remains. 1 if it was not confirmed.

    Asks first unless `yes`; ConfigError where there is no terminal to ask at.
    """
    study = StudyFolder(folder)
    with study.opened() as plan:
        plan.participant(pseudonym)
        removed = [one for one in plan.trials if one.participant == pseudonym and one.attempts]
        what = f"{len(removed)} trials with all attempts, the tables and the report"
        if not yes and not _confirmed(f"Delete {pseudonym} in {folder}: {what}?", console):
            console.print("Nothing was deleted.")
            return 1
        plan = study.forget(plan, pseudonym)
    remaining = sum(trial.is_done for trial in plan.trials)
    console.print(
        f"{pseudonym} is forgotten: {what} are deleted. What remains: {remaining} finished trials "
        f"of the others, and in the plan that {pseudonym} took part and is forgotten. Copies made "
        "elsewhere, and reports written with --out, are yours to delete. `study report` makes the "
        "report anew.",
        soft_wrap=True,
    )
    return 0


def show_study(folder: Path, console: Console, as_json: bool = False) -> int:
    """`study show`: how far each participant is, and what failed or is void.

    `as_json`: print one object instead.
    """
    plan = StudyFolder(folder).load()
    people = [_progress_of(plan, person) for person in plan.participants]
    if as_json:
        tree = {
            "name": plan.name,
            "simulated": plan.simulated,
            "trials": len(plan.trials),
            "balance": balance_sentence(plan),
            "participants": people,
        }
        console.out(json.dumps(tree))
        return 0
    whose = "simulated operators" if plan.simulated else "people at the hardware"
    title = f"{plan.name}: {len(plan.trials)} trials, {whose}"
    table = Table(title=title, title_justify="left")
    for heading in ("participant", "done", "planned", "void or failed attempts", "next"):
        table.add_column(heading)
    for person in people:
        is_here = person["done"] is not None
        numbers = [str(person[key]) for key in ("done", "planned", "void_or_failed")]
        shown = [*numbers, person["next"] or ""] if is_here else [person["state"], "", "", ""]
        table.add_row(person["participant"], *shown)
    console.print(table)
    console.print(balance_sentence(plan), soft_wrap=True)
    console.print(str(folder), style="bold")
    return 0


def report_study(
    folder: Path,
    console: Console,
    out: Path | None = None,
    tolerance_ssim: float | None = None,
    config: Config | None = None,
) -> int:
    """`study report`: tables, and the report with its figures.

    `config`: that of a study of which `folder` holds only the tables that an earlier report has
    left. Remarks are taken from remarks.txt in `folder`. SetupError without the extra `study`.
    """
    require_extra("study", "study report")
    from tams_app.study.report.build import build_report
    from tams_app.study.results import read_results, read_tables, write_tables

    data = read_results(StudyFolder(folder)) if config is None else read_tables(folder, config)
    if not len(data.trials):
        raise ConfigError(f"{folder}: no trial is done yet: run `study run` first")
    written: list[Path] = []
    # on standard error: standard output lists the files, for programs too
    with waiting("writing tables and report", Console(stderr=True)):
        if config is None:
            written = write_tables(data, inner_folder(folder, TABLES_NAME))
            out = out or inner_folder(folder, REPORT_NAME)
        remarks = folder / REMARKS_NAME
        text = remarks.read_text("utf-8", "replace")[:REMARKS_BYTES] if remarks.is_file() else ""
        page = build_report(data, text, tolerance_ssim).write(out or folder)
    for path in (page, *written):
        console.print(str(path), style="bold")
    return 0


def _confirmed(question: str, console: Console) -> bool:
    if not sys.stdin.isatty():
        raise ConfigError("`study forget` asks before it deletes: without a terminal add --yes")
    return Confirm.ask(f"{escape(question)} It cannot be undone.", console=console)


def _show_how_to_go_on(study: StudyFolder, console: Console) -> None:
    trials = study.load().trials
    done = sum(trial.is_done for trial in trials)
    console.print(
        f"Stopped: {done} of {len(trials)} trials are done and kept. "
        f"`study run --sim {study.path}` goes on with the others.",
        soft_wrap=True,
    )


def _progress_of(plan: Plan, person: Participant) -> dict[str, Any]:
    """How far a participant is; one who does not take part has no numbers.

    void_or_failed: attempts that do not count, those that were interrupted among them.
    """
    found: dict[str, Any] = {"participant": person.id, "state": person.state.value}
    if person.state is not ParticipantState.TAKES_PART:
        return found | dict.fromkeys(("done", "planned", "void_or_failed", "next"))
    mine = [trial for trial in plan.trials if trial.participant == person.id]
    done = sum(trial.is_done for trial in mine)
    return found | {
        "done": done,
        "planned": len(mine) - done,
        "void_or_failed": sum(len(trial.attempts) for trial in mine) - done,
        "next": next((trial.id for trial in mine if not trial.is_done), None),
    }

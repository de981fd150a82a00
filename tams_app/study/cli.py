"""`run_tams.py study`: commands and options only, which import what they need when they run."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from tams_app.config import load_config
from tams_app.console.options import ConfigOption, Override, overriding
from tams_app.errors import ConfigError, SetupError

app = typer.Typer(
    help="Plan, run and report a study (docs/STUDY.md). Every strategy is tried on every "
    "network, with simulated or real operators.",
)
DEFAULT_FOLDER = Path("logs/study")
Folder = Annotated[
    Path | None, typer.Argument(metavar="[DIR]", help=f"The study's folder; {DEFAULT_FOLDER}.")
]
OutOption = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="The same as DIR.")]
PARTICIPANTS_HELP = "How many; multiples of 18 are balanced."
_DESIGN = {
    "sim": Override("rig.enabled", "Use the simulated rig and operator, not people at hardware."),
    "repetitions": Override("study.repetitions", "Trials of each strategy on each network."),
    "practice": Override("study.practice_trials", "Practice trials at the start, never analysed."),
    "seed": Override("seed", "Seed for participants and trials."),
    "preset": Override("preset", "reference: the constants of the authors' nodes."),
}


@app.command()
@overriding(
    "folder sim participants repetitions practice seed config out workers dask participant",
    _DESIGN,
)
def run(
    overrides: dict[str, Any],
    folder: Folder = None,
    participants: Annotated[int | None, typer.Option(help=PARTICIPANTS_HELP)] = None,
    config: ConfigOption = None,
    out: OutOption = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Trials at a time; default one per core.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Scheduler of the cluster to use.")
    ] = None,
    participant: Annotated[
        str | None, typer.Option(help="Who is present; default the first with trials left.")
    ] = None,
) -> None:
    """Run a study's remaining trials, after planning it if needed.

    It can be stopped at any time; the same command continues it.
    """
    sim = bool(overrides["rig.enabled"])
    _check_run_options(sim, workers, dask, participant)
    from tams_app.study import commands

    study = commands.study_to_run(_folder(folder, out), sim, participants, overrides, config)
    if sim:
        if find_spec("mujoco") is None:
            raise SetupError("simulated trials need MuJoCo: pip install mujoco")
        from tams_app.study.runner import SimulatedTrialRunner

        simulated = SimulatedTrialRunner(study.config())
        raise typer.Exit(commands.run_simulated(study, simulated, _console(), workers, dask))
    from tams_app.study.live_trial import LiveTrialRunner

    live = LiveTrialRunner(study.config())
    raise typer.Exit(commands.run_guided(study, live, participant, _console()))


@app.command()
@overriding("participants folder repetitions practice seed config sim out preset", _DESIGN)
def plan(
    overrides: dict[str, Any],
    participants: Annotated[int, typer.Option(help=PARTICIPANTS_HELP)],
    folder: Folder = None,
    config: ConfigOption = None,
    out: OutOption = None,
) -> None:
    """Plan a new study: participants, trials, order and seeds."""
    settings = load_config(config, overrides)
    from tams_app.study.commands import plan_study

    raise typer.Exit(plan_study(settings, _folder(folder, out), participants, _console()))


@app.command()
def show(
    folder: Folder = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show progress, and which trials failed or are void."""
    from tams_app.study.commands import show_study

    raise typer.Exit(show_study(_folder(folder), _console(), as_json))


@app.command()
def void(
    trial: Annotated[str, typer.Argument(metavar="TRIAL", help="As in `show`: P01-03, …")],
    reason: Annotated[str, typer.Option(help="Why the trial does not count; kept with its data.")],
    folder: Folder = None,
) -> None:
    """Void the last attempt at a trial; it is kept, and repeated."""
    from tams_app.study.commands import void_trial

    raise typer.Exit(void_trial(_folder(folder), trial, reason, _console()))


@app.command()
def forget(
    participant: Annotated[str, typer.Argument(metavar="PARTICIPANT", help="As in `show`: P01, …")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The study's folder.")],
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Delete a participant's data and everything computed from it. This cannot be undone."""
    from tams_app.study.commands import forget_participant

    raise typer.Exit(forget_participant(folder, participant, _console(), yes))


@app.command()
def report(
    folder: Folder = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder to write; default in the study.")
    ] = None,
    tolerance_ssim: Annotated[
        float | None,
        typer.Option(min=0, help="SSIM tolerance between processors, to state in the report."),
    ] = None,
    from_tables: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Read DIR's trials.csv and phases.csv, not a study."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="The configuration of the study of --from-tables.")
    ] = None,
) -> None:
    """Create tables, figures and the HTML report from the trials so far."""
    from tams_app.study import commands

    if from_tables is not None and folder is not None:
        raise ConfigError(f"{folder} and --from-tables {from_tables}: give one of them")
    if config is not None and from_tables is None:
        raise ConfigError("--config is for --from-tables: a study keeps its own configuration")
    settings = None if from_tables is None else load_config(config)
    where = from_tables or _folder(folder)
    raise typer.Exit(commands.report_study(where, _console(), out, tolerance_ssim, settings))


def _check_run_options(
    sim: bool, workers: int | None, dask: str | None, participant: str | None
) -> None:
    """ConfigError for options that mean nothing to this kind of study."""
    if sim and participant is not None:
        raise ConfigError("--participant is for people at the hardware: leave it out with --sim")
    if not sim and (workers is not None or dask is not None):
        option = "--dask" if workers is None else "--workers"
        raise ConfigError(f"{option} is for simulated trials: add --sim, or leave it out")
    if workers is not None and dask is not None:
        raise ConfigError("--workers counts processes on this machine: leave it out with --dask")


def _folder(given: Path | None, out: Path | None = None) -> Path:
    if given is not None and out is not None and given != out:
        raise ConfigError(f"{given} and --out {out}: give one folder")
    return given or out or DEFAULT_FOLDER


def _console() -> Any:
    from tams_app.printing import Console

    return Console()

"""`run_tams.py calibrate`: the commands and their options; wizards are imported when asked for.

The docstring of a command's options is what its --help says of it.
"""

from __future__ import annotations

import inspect
import pkgutil
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

ConfigOption = Annotated[
    Path | None, typer.Option(help="Configuration file; default config/tams.yaml.")
]


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Options of every calibration."""

    config: ConfigOption = None
    sim: Annotated[
        bool, typer.Option("--sim", help="Use the simulated rig and a simulated person.")
    ] = False
    seed: Annotated[int, typer.Option(min=0, help="Seed for the simulation.")] = 0


@dataclass(frozen=True, kw_only=True)
class WizardOptions(CalibrationOptions):
    """Options of every wizard."""

    yes: Annotated[bool, typer.Option("--yes", help="Write the result without asking.")] = False


@dataclass(frozen=True, kw_only=True)
class FitOptions(CalibrationOptions):
    """Options of fits to recorded sessions, whose result may do no better than what is there."""

    logs: Annotated[
        list[Path],
        typer.Option("--from", metavar="LOG", help="A recorded session folder; may be repeated."),
    ] = field(default_factory=list)
    accept_unfounded: Annotated[
        bool,
        typer.Option("--accept-unfounded", help="Accept a result that its figures do not support."),
    ] = False


@dataclass(frozen=True, kw_only=True)
class CameraOptions(WizardOptions):
    """Assign cameras to views; measure latency, lens and mount."""

    only: Annotated[
        str,
        typer.Option(
            help="Steps: which (default), latency; with a board: lens, mount.",
            show_default=False,
        ),
    ] = ""
    square_mm: Annotated[
        float,
        typer.Option(min=5, max=200, help="lens, mount: measured side of a printed square."),
    ] = 36.0


@dataclass(frozen=True, kw_only=True)
class FrameOptions(WizardOptions):
    """Measure how the controller's axes lie; check its buttons."""

    buttons: Annotated[bool, typer.Option(help="Check each button first.")] = True
    rounds: Annotated[int, typer.Option(min=1, max=6, help="Strokes along each axis.")] = 2


@dataclass(frozen=True, kw_only=True)
class PhaseOptions(FitOptions):
    """Fit the thresholds of Algorithm 1 to marked trials."""

    trials: Annotated[
        int | None, typer.Option(help="--sim: trials to fit on; default 10.", show_default=False)
    ] = None
    held_out: Annotated[
        int | None,
        typer.Option(
            min=0, help="--sim: trials to test on; default as --trials.", show_default=False
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class WeightOptions(WizardOptions, FitOptions):
    """Derive the view weights W from people's ratings of clips."""

    ratings: Annotated[
        Path | None, typer.Option(help="Use the rating files in this folder, without asking.")
    ] = None
    folder: Annotated[
        Path | None, typer.Option(help="Folder for clips and ratings; default logs/weights.")
    ] = None
    context_s: Annotated[
        float, typer.Option(min=0, max=2, help="Seconds shown before and after each phase.")
    ] = 0.0


app = typer.Typer(
    help="Calibrate this setup. Each wizard measures, and writes a dated file that every "
    "command then uses. All but `phases` say what to do and ask first.",
)


def _add(wizard: str, declared: type[CalibrationOptions]) -> None:
    """A command with one option for each field of `declared`, explained by its docstring."""

    def command(**given: Any) -> None:
        from calibration.kit import WizardUI

        raise typer.Exit(pkgutil.resolve_name(wizard)(WizardUI(), declared(**given)).run())

    hints = get_type_hints(declared, include_extras=True)
    parameters = [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=one.default if one.default is not MISSING else [],
            annotation=hints[one.name],
        )
        for one in fields(declared)
    ]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    app.command(wizard.split(".")[1], help=declared.__doc__)(command)


for _wizard, _declared in {
    "calibration.cameras.wizard:CameraWizard": CameraOptions,
    "calibration.frame.wizard:FrameWizard": FrameOptions,
    "calibration.phases.wizard:PhaseWizard": PhaseOptions,
    "calibration.weights.wizard:WeightWizard": WeightOptions,
}.items():
    _add(_wizard, _declared)


@app.command()
def board(
    file: Annotated[Path, typer.Argument(help="PDF file to write.")] = Path("board.pdf"),
) -> None:
    """Write the board for `cameras --only lens,mount` as a PDF."""
    from calibration.cameras.board import print_board

    print_board(file)
    typer.echo(
        f"Written: {file}\nPrint it at 100 %, glue it onto something flat, measure a square of it, "
        "and give that as --square-mm."
    )


@app.command()
def show(config: ConfigOption = None) -> None:
    """Show the calibration in force: files, origin, accuracy."""
    from calibration.kit import WizardUI
    from calibration.store import show_in_force

    show_in_force(WizardUI(), config)


@app.command()
def undo(config: ConfigOption = None) -> None:
    """Undo the last calibration: the one before is in force again."""
    from calibration.kit import WizardUI
    from calibration.store import undo_last

    undo_last(WizardUI(), config)

"""`run_tams.py calibrate`: the commands; wizards are imported when asked for."""

from __future__ import annotations

import inspect
import pkgutil
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from calibration.options import (
    CalibrationOptions,
    CameraOptions,
    ConfigOption,
    FrameOptions,
    PhaseOptions,
    WeightOptions,
)

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

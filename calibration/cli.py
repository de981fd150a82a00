"""`run_tams.py calibrate`: the commands; the wizards are imported when asked for."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

from calibration.options import (
    CalibrationOptions,
    CameraOptions,
    ConfigOption,
    FrameOptions,
    PhaseOptions,
    WeightOptions,
)

Options = TypeVar("Options", bound=CalibrationOptions)
app = typer.Typer(
    help="Calibrate this setup. Each wizard measures, and writes a dated file that every "
    "command then uses. All but `phases` say what to do and ask first.",
)


def _command(
    declared: type[Options],
) -> Callable[[Callable[[Options], int]], Callable[..., None]]:
    """Turn a function of an options dataclass into a command with one option for each field."""

    def register(wizard: Callable[[Options], int]) -> Callable[..., None]:
        def command(**given: Any) -> None:
            raise typer.Exit(wizard(declared(**given)))

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
        return app.command(wizard.__name__, help=wizard.__doc__)(command)

    return register


@_command(CameraOptions)
def cameras(options: CameraOptions) -> int:
    """Assign cameras to views; measure latency, lens and mount."""
    from calibration.cameras.wizard import CameraWizard
    from calibration.ui import WizardUI

    return CameraWizard(WizardUI(), options).run()


@_command(FrameOptions)
def frame(options: FrameOptions) -> int:
    """Measure how the controller's axes lie; check its buttons."""
    from calibration.frame.wizard import FrameWizard
    from calibration.ui import WizardUI

    return FrameWizard(WizardUI(), options).run()


@_command(PhaseOptions)
def phases(options: PhaseOptions) -> int:
    """Fit the thresholds of Algorithm 1 to marked trials."""
    from calibration.phases.command import calibrate_phases
    from calibration.ui import WizardUI

    return calibrate_phases(WizardUI(), options)


@_command(WeightOptions)
def weights(options: WeightOptions) -> int:
    """Derive the view weights W from people's ratings of clips."""
    from calibration.ui import WizardUI
    from calibration.weights.wizard import WeightWizard

    return WeightWizard(WizardUI(), options).run()


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
    from calibration.in_force import show_in_force

    show_in_force(config)


@app.command()
def undo(config: ConfigOption = None) -> None:
    """Undo the last calibration: the one before is in force again."""
    from calibration.in_force import undo_last

    undo_last(config)

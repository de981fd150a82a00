"""The options of `run_tams.py calibrate`, by wizard; the docstring of a command's is its --help."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

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

    sim: Annotated[
        bool, typer.Option("--sim", help="Let simulated raters rate the clips of --from LOG.")
    ] = False

    ratings: Annotated[
        Path | None, typer.Option(help="Use the rating files in this folder, without asking.")
    ] = None
    folder: Annotated[
        Path | None, typer.Option(help="Folder for clips and ratings; default logs/weights.")
    ] = None
    context_s: Annotated[
        float, typer.Option(min=0, max=2, help="Seconds shown before and after each phase.")
    ] = 0.0

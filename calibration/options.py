"""The options of the wizards: declared here once, for the command line and for the wizards."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

ConfigOption = Annotated[
    Path | None, typer.Option(help="Configuration file; default config/tams.yaml.")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class WizardOptions:
    """Options of every wizard."""

    config: ConfigOption = None
    sim: Annotated[
        bool, typer.Option("--sim", help="Use the simulated rig and a simulated person.")
    ] = False
    logs: Annotated[
        list[Path],
        typer.Option("--from", metavar="LOG", help="A recorded session folder; may be repeated."),
    ] = field(default_factory=list)
    figure: Annotated[
        Path | None,
        typer.Option("--figure", "--picture", help="Draw the result to this .png or .jpg."),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Seed for the simulation.")] = 0
    yes: Annotated[bool, typer.Option("--yes", help="Write the result without asking.")] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions(WizardOptions):
    """Options of `calibrate cameras`."""

    only: Annotated[
        str,
        typer.Option(
            help="Steps: which,focus,exposure,rate (default), latency; with a board: lens, mount.",
            show_default=False,
        ),
    ] = ""
    square_mm: Annotated[
        float,
        typer.Option(min=5, max=200, help="lens, mount: measured side of a printed square."),
    ] = 36.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOptions(WizardOptions):
    """Options of `calibrate frame`."""

    touch: Annotated[
        Path | None,
        typer.Option(metavar="POINTS.csv", help="Touch these points (x_mm, y_mm, z_mm) instead."),
    ] = None
    keep_scale: Annotated[
        bool, typer.Option("--keep-scale", help="--touch: do not change hand.translation_scale.")
    ] = False
    buttons: Annotated[bool, typer.Option(help="Check each button first.")] = True
    rounds: Annotated[int, typer.Option(min=1, max=6, help="Strokes along each axis.")] = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions(WizardOptions):
    """Options of the wizards whose result may do no better than what is there."""

    accept_unfounded: Annotated[
        bool,
        typer.Option(
            "--accept-unfounded", help="--yes: accept a result that its figures do not support."
        ),
    ] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseOptions(FitOptions):
    """Options of `calibrate phases`."""

    mark: Annotated[
        bool, typer.Option("--mark", help="Mark the phases of each LOG by keys during its replay.")
    ] = False
    trials: Annotated[
        int | None, typer.Option(help="--sim: trials to fit on; default 10.", show_default=False)
    ] = None
    held_out: Annotated[
        int | None,
        typer.Option(
            min=0, help="--sim: trials to test on; default as --trials.", show_default=False
        ),
    ] = None
    goal_height_mm: Annotated[
        float | None,
        typer.Option(help="Align and pre-release only below this height over the goal."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightOptions(FitOptions):
    """Options of `calibrate weights`."""

    ratings: Annotated[
        Path | None, typer.Option(help="Use the rating files in this folder, without asking.")
    ] = None
    folder: Annotated[
        Path | None, typer.Option(help="Folder for clips and ratings; default logs/weights.")
    ] = None
    panel: Annotated[
        str, typer.Option(help="--sim: paper (prefers the views of its Table I) or indifferent.")
    ] = "paper"
    context_s: Annotated[
        float, typer.Option(min=0, max=2, help="Seconds shown before and after each phase.")
    ] = 0.0

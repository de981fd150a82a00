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
        bool, typer.Option("--sim", help="The simulated rig, and a simulated person.")
    ] = False
    logs: Annotated[
        list[Path],
        typer.Option("--from", metavar="LOG", help="A recorded session folder; may be repeated."),
    ] = field(default_factory=list)
    figure: Annotated[
        Path | None,
        typer.Option("--figure", "--picture", help="Draw the result to this .png or .jpg."),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Of what is simulated.")] = 0
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
        typer.Option(min=5, max=200, help="lens, mount: a square of the printed board, measured."),
    ] = 36.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOptions(WizardOptions):
    """Options of `calibrate frame`."""

    touch: Annotated[
        Path | None,
        typer.Option(metavar="POINTS.csv", help="Touch these points (x_mm, y_mm, z_mm) instead."),
    ] = None
    keep_scale: Annotated[
        bool, typer.Option("--keep-scale", help="--touch: leave hand.translation_scale alone.")
    ] = False
    buttons: Annotated[bool, typer.Option(help="Press each button first.")] = True
    rounds: Annotated[int, typer.Option(min=1, max=6, help="Strokes along each axis.")] = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions(WizardOptions):
    """Options of the wizards whose result may do no better than what is there."""

    accept_unfounded: Annotated[
        bool,
        typer.Option(
            "--accept-unfounded", help="With --yes: also a result that the figures do not support."
        ),
    ] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseOptions(FitOptions):
    """Options of `calibrate phases`."""

    mark: Annotated[
        bool, typer.Option("--mark", help="Mark the phases of each LOG in its replay, by keys.")
    ] = False
    trials: Annotated[
        int | None, typer.Option(help="--sim: to learn from; default 10.", show_default=False)
    ] = None
    held_out: Annotated[
        int | None,
        typer.Option(
            min=0, help="--sim: to judge by only; default as --trials.", show_default=False
        ),
    ] = None
    goal_height_mm: Annotated[
        float | None,
        typer.Option(help="Align and pre-release only so low over the goal; default any height."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightOptions(FitOptions):
    """Options of `calibrate weights`."""

    ratings: Annotated[
        Path | None, typer.Option(help="Build from the rating files in there, without asking.")
    ] = None
    folder: Annotated[
        Path | None, typer.Option(help="Where clips and ratings are kept; default logs/weights.")
    ] = None
    panel: Annotated[
        str, typer.Option(help="--sim: paper (prefers its Table I's views) or indifferent.")
    ] = "paper"
    context_s: Annotated[
        float, typer.Option(min=0, max=2, help="Also shown before and after each phase.")
    ] = 0.0

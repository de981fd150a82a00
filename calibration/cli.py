"""`run_tams.py calibrate`: commands and options only; the wizards are imported when asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    help="Measure this setup: each wizard says what to do, shows what it measures, and asks "
    "before it writes a dated file that every other command then uses.",
)

ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="Configuration file; default config/tams.yaml.")
]
SimOption = Annotated[
    bool, typer.Option("--sim", help="The simulated rig, and a simulated person.")
]
FromOption = Annotated[
    list[Path] | None,
    typer.Option("--from", metavar="LOG", help="A recorded session folder; may be repeated."),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Of what is simulated.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Write the result without asking.")]


@app.callback()
def _calibrate() -> None:
    """Keeps the sub-commands' names even while there is only one of them."""


@app.command()
def cameras(
    config: ConfigOption = None,
    sim: SimOption = False,
    log: FromOption = None,
    only: Annotated[
        str,
        typer.Option(
            help="Steps: which,focus,exposure,rate (default), latency,clocks,intrinsics.",
            show_default=False,
        ),
    ] = "",
    board: Annotated[
        Path | None, typer.Option(help="Draw the board for the lenses, .png or .pdf, and end.")
    ] = None,
    square_mm: Annotated[float, typer.Option(min=5.0, help="Edge of the board's squares.")] = 28.0,
    pattern_hz: Annotated[
        int, typer.Option(min=10, max=240, help="Refresh rate of the screen, for the latency.")
    ] = 60,
    picture: Annotated[
        Path | None, typer.Option(help="Draw what was found to this .png or .jpg.")
    ] = None,
    seed: SeedOption = 0,
    yes: YesOption = False,
) -> None:
    """Which camera is which, focus, light, frame rate; and latency, clocks, lenses if wanted."""
    from calibration.cameras.wizard import Options, run_cameras
    from calibration.desk import TerminalDesk

    options = Options(
        sim=sim,
        logs=tuple(log or ()),
        only=only,
        board=board,
        square_mm=square_mm,
        pattern_hz=pattern_hz,
        picture=picture,
        seed=seed,
        yes=yes,
    )
    raise typer.Exit(run_cameras(TerminalDesk(), config, options))


@app.command()
def frame(
    config: ConfigOption = None,
    sim: SimOption = False,
    log: FromOption = None,
    touch: Annotated[
        Path | None,
        typer.Option(metavar="POINTS.csv", help="Touch these points (x_mm, y_mm, z_mm) instead."),
    ] = None,
    keep_scale: Annotated[
        bool, typer.Option("--keep-scale", help="--touch: leave hand.translation_scale alone.")
    ] = False,
    buttons: Annotated[bool, typer.Option(help="Press each button first.")] = True,
    rounds: Annotated[int, typer.Option(min=1, max=6, help="Strokes along each axis.")] = 2,
    picture: Annotated[Path | None, typer.Option(help="Draw the fit to this PNG too.")] = None,
    seed: SeedOption = 0,
    yes: YesOption = False,
) -> None:
    """The controller's frame and buttons, from moving along the robot's axes."""
    from calibration.desk import TerminalDesk
    from calibration.frame.wizard import Options, run_frame

    options = Options(
        sim=sim,
        logs=tuple(log or ()),
        touch=touch,
        keep_scale=keep_scale,
        buttons=buttons,
        rounds=rounds,
        seed=seed,
        picture=picture,
        yes=yes,
    )
    raise typer.Exit(run_frame(TerminalDesk(), config, options))


@app.command()
def phases(
    config: ConfigOption = None,
    sim: SimOption = False,
    log: FromOption = None,
    mark: Annotated[
        bool, typer.Option("--mark", help="Mark the phases of each LOG on a replay as text.")
    ] = False,
    trials: Annotated[
        int | None, typer.Option(help="--sim: to learn from; default 10.", show_default=False)
    ] = None,
    held_out: Annotated[
        int | None,
        typer.Option(help="--sim: to judge by only; default as --trials.", show_default=False),
    ] = None,
    goal_height_mm: Annotated[
        float | None,
        typer.Option(help="Align and pre-release only so low over the goal; default any height."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the sensitivity to this PNG too.")
    ] = None,
    seed: SeedOption = 0,
    yes: YesOption = False,
) -> None:
    """The thresholds by which Algorithm 1 tells the phases, from trials whose phases are known."""
    from calibration.desk import TerminalDesk
    from calibration.phases.wizard import Options, run_phases

    options = Options(
        logs=tuple(log or ()),
        sim=sim,
        trials=trials,
        held_out=held_out,
        seed=seed,
        goal_height_mm=goal_height_mm,
        mark=mark,
        picture=picture,
        yes=yes,
    )
    raise typer.Exit(run_phases(TerminalDesk(), config, options))


@app.command()
def weights(
    config: ConfigOption = None,
    sim: SimOption = False,
    log: FromOption = None,
    ratings: Annotated[
        Path | None, typer.Option(help="Build from the rating files in there; ask nobody.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option(help="Where clips and ratings are kept; default logs/weights.")
    ] = None,
    panel: Annotated[
        str, typer.Option(help="--sim: paper (prefers its Table I's views) or indifferent.")
    ] = "paper",
    context_s: Annotated[
        float, typer.Option(min=0, max=2, help="Also shown before and after each phase.")
    ] = 0.0,
    seed: SeedOption = 0,
    yes: YesOption = False,
) -> None:
    """The view weights W from people's ratings of clips of recorded sessions."""
    from calibration.weights.wizard import Options, run_weights

    options = Options(config, sim, tuple(log or ()), ratings, folder, panel, context_s, seed, yes)
    raise typer.Exit(run_weights(options))

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
SeedOption = Annotated[int, typer.Option(help="Of what is simulated.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Write the result without asking.")]


@app.callback()
def _calibrate() -> None:
    """Keeps the sub-commands' names even while there is only one of them."""

"""`replay --recompute`: a table of what today's code makes of a session's inputs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import typer
from rich.table import Table

from tams_app.console.replay.logged_config import logged_config
from tams_app.console.report import session_log
from tams_app.printing import Console
from tams_app.progress import waiting
from tams_app.recording import SessionLog, read_log
from tams_app.session.recompute import Comparison, Recomputed, recompute
from tams_app.units import NS_PER_S


def run_recompute(given: Path, as_json: bool) -> int:
    """Compare the log of a session with what is computed from it now.

    The exit code: 0 if nothing differs by more than its tolerance, else 1.
    """
    path = session_log(given)
    with waiting("reading the log and computing it anew", Console(stderr=as_json)):
        log = read_log(path)
        found = recompute(log, logged_config(log, path))
    if as_json:
        typer.echo(json.dumps(_tree(log, found)))
    else:
        console = Console()
        console.print(_table(log, found))
        console.print(_sentence(log, found))
        if log.damage:
            console.print(log.damage, style="bold", highlight=False, soft_wrap=True)
    return 0 if found.same else 1


def _table(log: SessionLog, found: Recomputed) -> Table:
    table = Table(title=f"Recomputed: {log.header.name}, recorded by TAMS {log.header.version}")
    table.add_column("what")
    for name in ("compared", "largest difference", "tolerance", "differ", "first at"):
        table.add_column(name, justify="right")
    for one in found.comparisons:
        first_s = _first_s(log, one)
        table.add_row(
            one.name,
            f"{one.compared}",
            _amount(one.largest, one.unit),
            _amount(one.tolerance, one.unit),
            f"{one.differing}",
            "" if first_s is None else f"{first_s:.3f} s",
        )
    return table


def _amount(difference: float, unit: str) -> str:
    if not unit:
        return "same" if difference == 0.0 else "not the same"
    return f"{difference:.2g} {unit}" if math.isfinite(difference) else "not comparable"


def _sentence(log: SessionLog, found: Recomputed) -> str:
    ended = ""
    if found.until_ns is not None:
        until_s = (found.until_ns - log.header.started_ns) / NS_PER_S
        ended = f" The log lacks records after {until_s:.1f} s: not all from there on is compared."
    if found.same:
        return f"Today's code does what the log says, within the tolerances.{ended}"
    return f"Today's code does not do what the log says.{ended}"


def _first_s(log: SessionLog, one: Comparison) -> float | None:
    return None if one.first_ns is None else (one.first_ns - log.header.started_ns) / NS_PER_S


def _tree(log: SessionLog, found: Recomputed) -> dict[str, object]:
    return {
        "same": found.same,
        "complete": log.complete and found.until_ns is None,
        "quantities": [
            {
                "name": one.name,
                "unit": one.unit,
                "tolerance": one.tolerance,
                "compared": one.compared,
                "largest": one.largest if math.isfinite(one.largest) else None,
                "differing": one.differing,
                "first_s": _first_s(log, one),
            }
            for one in found.comparisons
        ],
    }

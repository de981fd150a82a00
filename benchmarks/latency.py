"""Where a frame's time goes in sessions as on hardware: cameras are played, nothing is rendered.

python -m benchmarks.latency --sessions 3
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from tams_app.printing import known
from tams_app.recording import read_log
from tams_app.summary import summarise
from tams_app.video.core.stages import STAGES
from tests.session.hardware_station import plugged, station

OWN = "without network"


def measured(seconds: float, fps: int, network: str) -> dict[str, dict[str, Any]]:
    """By view, p50 and p95 of each stage [ms] while an operator reaches up and down."""
    with (
        tempfile.TemporaryDirectory(prefix="tams-latency-") as folder,
        plugged(Path(folder), fps) as there,
    ):
        with station(there, there.config(network=network)) as here:
            here.await_frames()
            until_s = time.monotonic() + seconds
            while time.monotonic() < until_s:
                here.make_ready()
                here.reach()
        views = summarise(read_log(here.folder / "session.mcap"))["views"]
    return {
        view: {**entry["latency_stages_ms"], OWN: entry["own_latency_ms"]}
        for view, entry in views.items()
    }


def table(sessions: list[dict[str, dict[str, Any]]]) -> Table:
    """A row for each view: the medians of the sessions."""
    shown = Table("view", *STAGES.values(), OWN, box=None)
    for view in sessions[0]:
        cells = []
        for stage in (*STAGES, OWN):
            values = [[one[view][stage][rank] for one in sessions] for rank in ("p50", "p95")]
            medians = [None if None in one else float(np.median(one)) for one in values]
            cells.append(" / ".join(known(value, "{:.1f}") for value in medians))
        shown.add_row(view, *cells)
    shown.caption = "p50 / p95 [ms], medians of the sessions"
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="of work in each (default 20)")
    parser.add_argument("--fps", type=int, default=30, help="of the cameras (default 30)")
    parser.add_argument("--network", default="s2")
    options = parser.parse_args()
    sessions = []
    for _ in range(options.sessions):
        sessions.append(measured(options.seconds, options.fps, options.network))
    Console(width=130).print(table(sessions))


if __name__ == "__main__":
    main()

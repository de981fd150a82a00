"""Sessions as on hardware, with played devices and the product's limits, a row each.

python -m benchmarks.played_sessions --sessions 10
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby, pairwise
from pathlib import Path

from rich.console import Console
from rich.table import Table

from tams_app.recording import SessionLog, read_log
from tams_app.summary import summarise
from tests.session.hardware_station import REACH_M, Plugged, plugged, station

GUARD = "guard"
FAULT = "fault"
RESULTS = Path(__file__).with_name("results") / "played_sessions.json"


@dataclass(frozen=True, slots=True)
class Row:
    """What one session came to."""

    guard_stops: int
    stops: tuple[str, ...]  # reasons of the faults, the guard's among them
    holds: tuple[str, ...]  # reasons
    late_percent: float  # of the control ticks
    longest_gap_ms: float  # between two control ticks
    fps_asked: float
    fps_given: float  # frames a second of the view with fewest
    reaches: int  # times that the arm followed the hand
    load_before: float  # of the machine, its mean of one minute


def session(there: Plugged, seconds: float, network: str) -> Row:
    """Reach up and down for `seconds`, as an operator does who confirms after each fault."""
    load, reaches = os.getloadavg()[0], 0
    with station(there, there.config(network=network)) as here:
        here.await_frames()
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            here.make_ready()
            reaches += here.reach() > REACH_M
    return row(read_log(here.folder / "session.mcap"), reaches, load)


def row(log: SessionLog, reaches: int, load_before: float) -> Row:
    """The figures of one session."""
    summary, started = summarise(log), [tick.started_ns for tick in log.ticks]
    views = summary["views"].values()
    troubles = list(_troubles(log))
    stops = tuple(reason for arming, reason in troubles if arming == FAULT)
    return Row(
        guard_stops=sum(GUARD in reason for reason in stops),
        stops=stops,
        holds=tuple(reason for arming, reason in troubles if arming != FAULT),
        late_percent=100.0 * summary["control"]["late_fraction"],
        longest_gap_ms=max(after - before for before, after in pairwise(started)) / 1e6,
        fps_asked=log.header.fps,
        fps_given=min(view["fps"]["given"] or 0.0 for view in views),
        reaches=reaches,
        load_before=load_before,
    )


def _troubles(log: SessionLog) -> Iterator[tuple[str, str]]:
    """Arming and reason of each time in which something held or stopped the arm, in order."""
    for (arming, reason), _ in groupby(log.ticks, key=lambda tick: (tick.arming, tick.reason)):
        if reason:
            yield arming, reason


def table(rows: Sequence[Row]) -> Table:
    """One line for each session, and the worst."""
    shown = Table(box=None)
    columns = ("session", "guard stops", "stops", "holds", "late", "gap", "frames/s", "reaches")
    for name in columns:
        shown.add_column(name, justify="right", no_wrap=True)
    for number, one in enumerate(rows):
        shown.add_row(str(number), *_cells(one))
    shown.caption = (
        f"{sum(one.guard_stops for one in rows)} stops by the guard in {len(rows)} sessions; "
        f"longest gap {max(one.longest_gap_ms for one in rows):.0f} ms"
    )
    return shown


def _cells(one: Row) -> list[str]:
    return [
        str(one.guard_stops),
        str(len(one.stops)),
        str(len(one.holds)),
        f"{one.late_percent:.2f} %",
        f"{one.longest_gap_ms:.0f} ms",
        f"{one.fps_given:.1f}/{one.fps_asked:g}",
        str(one.reaches),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0, help="of work in each (default 20)")
    parser.add_argument("--fps", type=int, default=30, help="of the cameras (default 30)")
    parser.add_argument("--network", default="s2")
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    console, rows = Console(width=110), []
    for number in range(options.sessions):
        with (
            tempfile.TemporaryDirectory(prefix="tams-played-") as folder,
            plugged(Path(folder), options.fps) as there,
        ):
            rows.append(session(there, options.seconds, options.network))
        one = rows[-1]
        words = (*_cells(one), *one.stops, *one.holds)
        console.print(f"session {number}: {'; '.join(words)}", highlight=False)
    console.print(table(rows))
    content = {
        "network": options.network,
        "seconds": options.seconds,
        "sessions": [asdict(one) for one in rows],
    }
    options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

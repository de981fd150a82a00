"""Whole live sessions, a row each: frames given, late ticks, use of the uplink, verdict.

python -m benchmarks.live_sessions --seeds 10
python -m benchmarks.live_sessions --seeds 1 --fps 5 10 15 30
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Literal

from rich.table import Table

from benchmarks.runs import Run, run_session
from tams_app.printing import Console

GUARD = "guard"


@dataclass(frozen=True, slots=True)
class Row:
    """What one session came to; of the views the worst."""

    seed: int
    operator: str
    fps_asked: float
    fps_given: float  # frames a second
    interval_p95_periods: float  # time between frames, in periods of the rate given most
    late_percent: float  # of the control ticks
    longest_gap_ms: float  # between two control ticks
    used_percent: float  # of the budget, sent by all views
    tracking_percent: float | None
    latency_p95_ms: float | None
    stops: tuple[str, ...]  # reasons
    guard_stops: int
    completion_s: float | None  # None: not placed


def row(run: Run, seed: int) -> Row:
    """The figures of one session."""
    summary = run.summary
    views = list(summary["views"].values())
    period_ms = [view["frame_interval_ms"]["p50"] for view in views]
    p95_ms = [view["frame_interval_ms"]["p95"] for view in views]
    errors = [view["tracking_error"] for view in views if view["tracking_error"] is not None]
    latencies = [
        view["latency_ms"]["p95"] for view in views if view["latency_ms"]["p95"] is not None
    ]
    started = [tick.started_ns for tick in run.log.ticks]
    reasons = tuple(stop["reason"] for stop in summary["arm"]["stops"])
    uplink = summary["uplink"]
    return Row(
        seed=seed,
        operator=summary["operator"]["kind"] or "",
        fps_asked=views[0]["fps"]["asked"],
        fps_given=min(view["fps"]["given"] or 0.0 for view in views),
        interval_p95_periods=max(p95 / p50 for p95, p50 in zip(p95_ms, period_ms, strict=True)),
        late_percent=100.0 * summary["control"]["late_fraction"],
        longest_gap_ms=max(after - before for before, after in pairwise(started)) / 1e6,
        used_percent=100.0 * uplink["sent_kbps_mean"] / uplink["budget_kbps_mean"],
        tracking_percent=100.0 * max(errors) if errors else None,
        latency_p95_ms=max(latencies) if latencies else None,
        stops=reasons,
        guard_stops=sum(GUARD in reason for reason in reasons),
        completion_s=summary["outcome"]["completion_time_s"],
    )


def table(rows: Sequence[Row]) -> Table:
    """One line for each session, and the medians."""
    shown = Table(box=None)
    columns = (
        "seed", "operator", "frames/s", "p95 interval", "late", "gap", "used", "error",
        "latency", "placed", "stops",
    )  # fmt: skip
    for name in columns:
        justify: Literal["left", "right"] = "left" if name in ("operator", "stops") else "right"
        shown.add_column(name, justify=justify, no_wrap=True)
    for one in rows:
        shown.add_row(str(one.seed), one.operator, *_cells(one), ", ".join(one.stops) or "none")
    placed = sum(one.completion_s is not None for one in rows)
    given = median(one.fps_given for one in rows)
    used = median(one.used_percent for one in rows)
    late = median(one.late_percent for one in rows)
    shown.caption = (
        f"{placed} of {len(rows)} placed; medians: {given:.1f} frames a second given, "
        f"{late:.2f} % late, {used:.0f} % of the budget used; "
        f"{sum(one.guard_stops for one in rows)} stops by the guard"
    )
    return shown


def _cells(one: Row) -> list[str]:
    tracking, latency = one.tracking_percent, one.latency_p95_ms
    return [
        f"{one.fps_given:.1f}/{one.fps_asked:g}",
        f"{one.interval_p95_periods:.2f} T",
        f"{one.late_percent:.2f} %",
        f"{one.longest_gap_ms:.0f} ms",
        f"{one.used_percent:.0f} %",
        "–" if tracking is None else f"{tracking:.1f} %",
        "–" if latency is None else f"{latency:.0f} ms",
        "no" if one.completion_s is None else f"{one.completion_s:.1f} s",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--network", default="s2")
    parser.add_argument("--seeds", type=int, default=10, help="sessions of each rate (default 10)")
    parser.add_argument("--fps", type=int, nargs="*", default=[], help="rates, one by one")
    parser.add_argument("--operator", choices=("seeing", "scripted"), default="seeing")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console, rows = Console(width=110), []
    chosen = ["--operator", options.operator]
    with tempfile.TemporaryDirectory(prefix="tams-live-") as folder:
        for fps in options.fps or [None]:
            rate = [] if fps is None else ["--fps", str(fps)]
            for seed in range(options.seeds):
                words = ["--network", options.network, "--seed", str(seed), *rate, *chosen]
                rows.append(row(run_session(Path(folder), *words), seed))
                console.print(f"seed {seed}: {'; '.join(_cells(rows[-1]))}")
    console.print(table(rows))
    if options.json:
        content = {"network": options.network, "sessions": [asdict(one) for one in rows]}
        options.json.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

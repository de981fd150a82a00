"""Which decides how good the frames are: allocation, encoder preset or loss repair?

`python -m benchmarks.experiments.ablation`: in virtual time, each cell with the same recorded
hands, scenes, noise and losses, so that the motion is the same and only the video differs. From
what the product does on a network one factor at a time is changed; `--full` runs all combinations.
Loss repair is
switched by `video.repair`: with RTX forced on where the product's rule has it off, the jitter
buffer waits for the resend; without PLI a damaged frame stays until the next keyframe (20 s).
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.experiments.ablation_cells import Cell, product_cell
from benchmarks.experiments.ablation_table import FactorRange, Figures, Row, ranges, rows
from benchmarks.experiments.ablation_trials import Trial, plan, record_hands, run
from tams_app.printing import Console
from tams_app.study.runner import machine
from tams_app.study.unattended import TrialsProgress

RESULTS = Path(__file__).parent / "results" / "ablation.json"
SEEDS, NETWORKS, PROCESSES = 5, ("s1", "s2", "s3"), 2
TABLE_WIDTH = 180  # characters: no column is cut short

# measure -> heading and format
COLUMNS = {
    "received_ssim": ("received", ".4f"),
    "delivered_ssim": ("delivered", ".4f"),
    "live_ssim": ("live", ".4f"),
    "latency_p50_ms": ("p50 [ms]", ".0f"),
    "latency_p95_ms": ("p95 [ms]", ".0f"),
    "frozen_s": ("frozen [s]", ".2f"),
    "residual_loss": ("residual loss", ".3%"),
    "sent_kbps": ("sent [kbit/s]", ".0f"),
    "encoding_cpu_ms": ("CPU [ms/frame]", ".2f"),
    "success": ("placed", ".0%"),
}


def collect(trials: Mapping[str, Trial], found: Mapping[str, Figures]) -> list[Row]:
    """The rows of all networks."""
    told: dict[str, dict[Cell, dict[int, Figures]]] = {}
    for name, trial in trials.items():
        cells = told.setdefault(trial.network, {})
        cells.setdefault(trial.cell, {})[trial.seed] = found[name]
    return [
        row
        for network, cells in told.items()
        for row in rows(network, product_cell(network), cells)
    ]


def table(found: Sequence[Row]) -> Table:
    shown = Table(box=None)
    shown.add_column("allocation, preset, repair")
    for heading, _ in COLUMNS.values():
        shown.add_column(heading, justify="right")
    shown.add_column("received − product's", justify="right")
    network = ""
    for row in found:
        if row.network != network:
            network = row.network
            shown.add_row(f"[bold]{network}[/], {row.seeds} seeds")
        values = [
            "–" if (value := row.means[measure]) is None else format(value, style)
            for measure, (_, style) in COLUMNS.items()
        ]
        shown.add_row(f"  {row.cell.name}", *values, _difference(row))
    return shown


def _difference(row: Row) -> str:
    if row.is_product:
        return "the product's"
    if row.against is None:
        return "–"
    value, low, high = row.against.value, row.against.low, row.against.high
    interval = "" if low is None or high is None else f" [{low:+.4f}, {high:+.4f}]"
    return f"{value:+.4f}{interval}".replace("[", "\\[")


def report(console: Console, options: argparse.Namespace) -> None:
    """Measure, print, write."""
    seeds, networks, full, path = options.seeds, options.networks, options.full, options.json
    with tempfile.TemporaryDirectory(prefix="tams-ablation-") as folder:
        console.print(f"recording a hand for each of {seeds} seeds")
        trials = plan(networks, record_hands(seeds, Path(folder)), full)
        with TrialsProgress(console, len(trials)) as bar:
            found = run(trials, Path(folder), options.processes, bar)
    told = collect(trials, found)
    moved = [
        one for network in networks for one in ranges([r for r in told if r.network == network])
    ]
    console.print(table(told))
    for one in moved:
        console.print(
            f"{one.network}: {one.factor} alone moves {one.measure} by {one.range:.4f} "
            f"(from {one.worst} to {one.best})",
            highlight=False,
        )
    words = f"--seeds {seeds} --networks {' '.join(networks)}{' --full' if full else ''}"
    write(path, f"python -m benchmarks.experiments.ablation {words}", told, moved, trials, found)
    console.print(f"written to {path}")


def write(
    path: Path,
    command: str,
    told: Sequence[Row],
    moved: Sequence[FactorRange],
    trials: Mapping[str, Trial],
    found: Mapping[str, Figures],
) -> None:
    content: dict[str, Any] = {
        "command": command,
        "machine": {**machine(), "cores": os.cpu_count()},
        "rows": [asdict(row) for row in told],
        "ranges": [asdict(one) for one in moved],
        "trials": [
            {
                "network": trial.network,
                **asdict(trial.cell),
                "seed": trial.seed,
                **found[name],
            }
            for name, trial in trials.items()
        ],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.experiments.ablation", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--networks", nargs="+", default=list(NETWORKS))
    parser.add_argument("--full", action="store_true", help="all combinations, 36 per seed")
    parser.add_argument("--processes", type=int, default=PROCESSES)
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    console = Console()
    if not console.is_terminal:  # a log file has no width
        console.width = TABLE_WIDTH
    report(console, options)


if __name__ == "__main__":
    main()

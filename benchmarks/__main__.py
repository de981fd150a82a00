"""`make bench`: measures what the product promises, prints a table and writes JSON.

Compare figures with others of the same run; machines differ and are noisy.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.progress import Progress
from rich.table import Table

from benchmarks import faults
from benchmarks.measures import (
    Figure,
    control_figures,
    latency_figures,
    rig_figures,
    start_figures,
    video_figures,
)
from benchmarks.runs import Run, run_session
from tams_app.config import DEFAULT_CONFIG
from tams_app.printing import Console

# three views at 1500 kbit/s each, nothing but loopback in between
LOOPBACK = f"""version: 1
include: [{DEFAULT_CONFIG}]
policy: {{budget: {{max_kbps: {4500 / 0.92:.0f}}}}}
"""
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="sessions on s2 (default 3)")
    parser.add_argument("--json", type=Path, default=RESULTS / "bench.json")
    options = parser.parse_args()
    console = Console()
    with (
        tempfile.TemporaryDirectory(prefix="tams-bench-") as folder,
        Progress(console=console) as progress,
    ):
        figures = measure(Path(folder), options.seeds, progress)
    console.print(table(figures))
    write(options.json, figures, options.seeds)
    console.print(f"written to {options.json}")
    console.print("stops by faults, measured at the arm (about four minutes)")
    rows = faults.measure()
    console.print(faults.table(rows))
    faults.write(options.json.with_name("faults.json"), rows)


def measure(out: Path, seeds: int, progress: Progress) -> list[Figure]:
    """Every figure, one session after the other."""
    task = progress.add_task("sessions on s2", total=seeds + 1)
    runs: list[Run] = []
    for seed in range(seeds):
        runs.append(run_session(out, "--network", "s2", "--seed", str(seed)))
        progress.update(task, advance=1)
    progress.update(task, description="session without a network")
    config = out / "loopback.yaml"
    config.write_text(LOOPBACK, encoding="utf-8")
    free = run_session(out, "--config", str(config), "--network", "none", "--strategy", "equal")
    progress.update(task, advance=1, description="done")
    return [
        *start_figures(runs),
        *control_figures(runs),
        *video_figures(runs),
        *latency_figures(free),
        *rig_figures(runs),
    ]


def table(figures: list[Figure]) -> Table:
    shown = Table(box=None)
    for name, justify in (
        ("what", "left"),
        ("measured", "right"),
        ("target", "right"),
        ("", "left"),
    ):
        shown.add_column(name, justify=justify)  # type: ignore[arg-type]
    group = ""
    for figure in figures:
        if figure.group != group:
            group = figure.group
            shown.add_row(f"[bold]{group}[/]")
        shown.add_row(
            f"  {figure.name}",
            "–" if figure.value is None else f"{figure.value:.3g} {figure.unit}",
            figure.target,
            figure.verdict,
        )
    return shown


def write(path: Path, figures: list[Figure], seeds: int) -> None:
    content = {
        "machine": {
            "cores": os.cpu_count(),
            "processor": platform.processor() or platform.machine(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "command": f"make bench ARGS='--seeds {seeds}'",
        "figures": [{**asdict(figure), "verdict": figure.verdict} for figure in figures],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

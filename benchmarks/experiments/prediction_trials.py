"""Whole trials in virtual time with the predictive display and without: live SSIM as in a log.

`python -m benchmarks.experiments.prediction_trials` runs each of five seeds with `view.predict` off
and on, over one-way latencies without jitter and loss and over s2. It compares the wrist view's
frames that were captured while the arm moves, and the primary view. The operator looks at the
frames as received, so that all else of a pair is the same.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.virtual_runs import read_summary, run_side_by_side
from tams_app.config import Network, load_config
from tams_app.recording import LOG_NAME, read_log
from tams_app.study.unattended import TrialsProgress

VIEW = "eih"
ONE_WAY_MS = (40.0, 100.0, 200.0)
PREDICT = ("off", "eih")
_MOVING_M_S = 0.02
_SESSION_S = 25.0
NETWORKS = {
    **{
        f"{one_way_ms:g} ms": Network(latency_ms=one_way_ms, rate_kbps=12_000.0)
        for one_way_ms in ONE_WAY_MS
    },
    "s2": None,
}


def run_sessions(seeds: int, processes: int, console: Console) -> dict[str, dict[str, list[float]]]:
    """By network and measure, its value in each trial."""
    configs = {}
    for (name, network), predict in product(NETWORKS.items(), PREDICT):
        word = name if network is None else "case"
        given = {} if network is None else {"networks.case": network.model_dump()}
        for seed in range(1, seeds + 1):
            configs[f"{name.split()[0]}-{predict}-{seed}"] = load_config(
                None,
                {
                    **given,
                    "network": word,
                    "seed": seed,
                    "view.predict": predict,
                    "rig.operator.looks_at": "received",
                    "seconds": _SESSION_S,
                    "recording.bitstream": False,
                },
            )
    found: dict[str, dict[str, list[float]]] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        TrialsProgress(console, len(configs)) as bar,
    ):
        run_side_by_side(configs, Path(folder), processes, bar.trial_ended)
        for name, predict, seed in product(NETWORKS, PREDICT, range(1, seeds + 1)):
            trial = Path(folder) / f"{name.split()[0]}-{predict}-{seed}"
            row = found.setdefault(name, {})
            row.setdefault(f"moving, {predict}", []).append(_moving_live(trial))
            primary = read_summary(trial)["primary_view"]
            row.setdefault(f"primary, {predict}", []).append(primary["live_ssim"])
            row.setdefault(f"primary received, {predict}", []).append(primary["received_ssim"])
    return found


def _moving_live(folder: Path) -> float:
    """Mean live SSIM of the wrist view's frames captured while the arm moves."""
    log = read_log(folder / LOG_NAME)
    times_ns = np.array([tick.started_ns for tick in log.ticks])
    moves = np.array([tick.speed > _MOVING_M_S for tick in log.ticks])
    scores = [
        one.live
        for one in log.quality
        if one.view == VIEW
        and one.live is not None
        and moves[min(np.searchsorted(times_ns, one.capture_ns), len(moves) - 1)]
    ]
    return float(np.mean(scores))


def sessions_table(found: dict[str, dict[str, list[float]]]) -> Table:
    shown = Table("network", "live SSIM", "off", "predicted", "difference, each trial", box=None)
    for name, row in found.items():
        for measure, of in (("moving", "eih, arm moving"), ("primary", "primary view")):
            before, after = row[f"{measure}, off"], row[f"{measure}, eih"]
            gains = " ".join(f"{b - a:+.3f}" for a, b in zip(before, after, strict=True))
            shown.add_row(name, of, f"{np.mean(before):.3f}", f"{np.mean(after):.3f}", gains)
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console()
    rows = run_sessions(options.seeds, options.processes, console)
    console.print(sessions_table(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

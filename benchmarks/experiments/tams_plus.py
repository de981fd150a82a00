"""What does `tams+` bring, against `tams`?

`python -m benchmarks.experiments.tams_plus [--networks s1 s2 s3 FILE]`: in virtual time, with the
same recorded hands, scenes, noise and losses for all strategies. A network that is a trace's file
has the delay, jitter and loss of s2; with each seed it begins a trial's length later. Differences
are those to `tams` seed by seed, with Student's t interval. Which frames a lost packet damages is
chance, and in a short phase one of them outweighs what coding gains: `--loss 0` shows that alone.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.ablation_trials import length_s, record_hands
from benchmarks.experiments.virtual_runs import read_summary, run_side_by_side
from tams_app.config import Config, load_config
from tams_app.study.runner import machine
from tams_app.study.statistics.estimates import Estimate, mean_interval
from tams_app.study.unattended import TrialsProgress

RESULTS = Path(__file__).parent / "results" / "tams_plus.json"
SEEDS, NETWORKS, PROCESSES = 12, ("s1", "s2", "s3"), 2
REFERENCE = "tams"
STRATEGIES = (REFERENCE, "tams+")
_LATER_S = 5.0  # a replay may end so long after its recording
_TRACE_STEP_S = 25.0
TABLE_WIDTH = 180

Figures = Mapping[str, float]

# measure -> what it is in summary.json
MEASURES: dict[str, Callable[[Any], float]] = {
    "primary live": lambda told: told["primary_view"]["live_ssim"],
    "primary received": lambda told: told["primary_view"]["received_ssim"],
    "worst view live": lambda told: min(view["live_ssim"] for view in told["views"].values()),
    "worst view received": lambda told: min(
        view["received_ssim"] for view in told["views"].values()
    ),
    "primary received, undamaged": lambda told: float(
        np.mean(
            [
                score
                for one in told["primary_view"]["by_phase"].values()
                if (score := one["undamaged_received_ssim"]) is not None
            ]
        )
    ),
    "latency p95 [ms]": lambda told: max(
        view["latency_ms"]["p95"] for view in told["views"].values()
    ),
    "frozen [s]": lambda told: sum(
        view["freezes"]["total_s"] or 0.0 for view in told["views"].values()
    ),
    "sent [kbit/s]": lambda told: told["uplink"]["sent_kbps_mean"],
}


@dataclass(frozen=True, slots=True)
class Trial:
    """One strategy on one network with one seed."""

    network: str
    strategy: str
    seed: int
    config: Config

    @property
    def id(self) -> str:
        return f"{Path(self.network).stem}-{self.strategy}-{self.seed}"


@dataclass(frozen=True, slots=True)
class Row:
    """One measure of one strategy: its mean, and its difference to `tams` seed by seed."""

    network: str
    strategy: str
    measure: str
    mean: float
    difference: Estimate | None


def link(network: str, loss: float | None, seed: int, out: Path) -> dict[str, Any]:
    """The keys that choose a network by its name or by the file of a trace."""
    path, known = Path(network), load_config().networks
    if not path.is_file():
        keys = {"network": network}
        return keys if loss is None else {**keys, f"networks.{network}.loss": loss}
    shifted = out / f"{path.stem}-{seed}.csv"
    shifted.write_text(_shifted(path.read_text(encoding="utf-8"), seed), encoding="utf-8")
    like = known["s2"]
    return {
        "network": "trace",
        "networks.trace": {
            "trace": str(shifted),
            "latency_ms": like.latency_ms,
            "jitter_ms": like.jitter_ms,
            "loss": like.loss if loss is None else loss,
        },
    }


def _shifted(text: str, seed: int) -> str:
    """The trace of equal steps begun later; what it began with comes at its end."""
    head, *lines = text.split()
    times, rates = zip(*(line.split(",") for line in lines), strict=True)
    first = round(seed * _TRACE_STEP_S * 1000 / float(times[1])) % len(rates)
    turned = rates[first:] + rates[:first]
    return "\n".join([head, *(f"{t},{r}" for t, r in zip(times, turned, strict=True)), ""])


def plan(
    networks: Sequence[str],
    hands: Mapping[int, Path],
    out: Path,
    loss: float | None,
) -> Iterator[Trial]:
    """All trials, seed by seed: what is cut short has whole pairs."""
    for seed, hand in hands.items():
        seconds = length_s(hand) + _LATER_S
        for network in networks:
            keys = link(network, loss, seed, out)
            for strategy in STRATEGIES:
                config = load_config(
                    None,
                    {
                        "strategy": strategy,
                        **keys,
                        "policy.budget.mode": "oracle",
                        "video.repair.mode": "paper",
                        "seed": seed,
                        "seconds": seconds,
                        "headless": True,
                        "rig.hand_trajectory": str(hand),
                        "recording.bitstream": False,
                    },
                )
                yield Trial(network, strategy, seed, config)


def rows(trials: Sequence[Trial], found: Mapping[str, Figures]) -> list[Row]:
    """The table: by network, strategy and measure; means over the seeds."""
    by_seed: dict[tuple[str, str], dict[int, Figures]] = {}
    for trial in trials:
        by_seed.setdefault((trial.network, trial.strategy), {})[trial.seed] = found[trial.id]
    told = []
    for (network, strategy), mine in by_seed.items():
        reference = by_seed[network, REFERENCE]
        for measure in MEASURES:
            apart = [mine[seed][measure] - reference[seed][measure] for seed in mine]
            mean = float(np.mean([figures[measure] for figures in mine.values()]))
            difference = None if strategy == REFERENCE else mean_interval(apart)
            told.append(Row(network, strategy, measure, mean, difference))
    return told


def table(told: Sequence[Row]) -> Table:
    """One row a strategy, one column a measure; the reference's means, the others' differences."""
    shown = Table(box=None)
    shown.add_column("network, strategy")
    for measure in MEASURES:
        shown.add_column(measure, justify="right")
    by_cell: dict[tuple[str, str], list[Row]] = {}
    for row in told:
        by_cell.setdefault((row.network, row.strategy), []).append(row)
    for (network, strategy), mine in by_cell.items():
        shown.add_row(f"{Path(network).stem}, {strategy}", *map(_cell, mine))
    return shown


def _cell(row: Row) -> str:
    digits = 1 if row.mean > 1 else 4
    if row.difference is None:
        return f"{row.mean:.{digits}f}"
    half = ""
    if row.difference.high is not None:
        half = f" ± {row.difference.high - row.difference.value:.{digits}f}"
    return f"{row.difference.value:+.{digits}f}{half}"


def report(
    console: Console,
    path: Path,
    seeds: int,
    networks: Sequence[str],
    loss: float | None,
    processes: int,
) -> None:
    """Measure, print, write."""
    with tempfile.TemporaryDirectory(prefix="tams-plus-") as folder:
        out = Path(folder)
        console.print(f"recording a hand for each of {seeds} seeds")
        trials = list(plan(networks, record_hands(seeds, out), out, loss))
        with TrialsProgress(console, len(trials)) as bar:
            configs = {trial.id: trial.config for trial in trials}
            run_side_by_side(configs, out, processes, bar.trial_ended)
        found = {trial.id: figures(read_summary(out / trial.id)) for trial in trials}
    told = rows(trials, found)
    console.print(table(told))
    content = {
        "command": f"python -m benchmarks.experiments.tams_plus --seeds {seeds} "
        f"--networks {' '.join(Path(name).name for name in networks)}"
        f"{'' if loss is None else f' --loss {loss:g}'}",
        "machine": {**machine(), "cores": os.cpu_count()},
        "rows": [
            {
                "network": Path(row.network).stem,
                "strategy": row.strategy,
                "measure": row.measure,
                "mean": row.mean,
                "difference": row.difference and row.difference.value,
                "low": row.difference and row.difference.low,
                "high": row.difference and row.difference.high,
                "seeds": seeds,
            }
            for row in told
        ],
        "trials": found,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    console.print(f"written to {path}")


def figures(summary: Any) -> dict[str, float]:
    """The measures of one trial."""
    return {measure: float(of(summary)) for measure, of in MEASURES.items()}


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.experiments.tams_plus", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--networks", nargs="+", default=list(NETWORKS))
    parser.add_argument("--loss", type=float, help="of all networks, instead of their own")
    parser.add_argument("--processes", type=int, default=PROCESSES)
    parser.add_argument("--json", type=Path, default=RESULTS)
    options = parser.parse_args()
    console = Console()
    if not console.is_terminal:  # a log file has no width
        console.width = TABLE_WIDTH
    report(
        console,
        options.json,
        options.seeds,
        options.networks,
        options.loss,
        options.processes,
    )


if __name__ == "__main__":
    main()

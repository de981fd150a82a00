"""Pairs of trials in virtual time that differ in one thing, with the simulated operator who sees.

Scene, noise, losses and participant of a pair are those of its seed. What has been run is kept in a
file and not run again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.virtual_runs import VirtualRuns, read_summary, run_side_by_side
from tams_app.config import Config
from tams_app.recording import SessionLog
from tams_app.study.statistics.estimates import paired_difference
from tams_app.study.unattended import TrialsProgress
from tams_app.units import NS_PER_S

OPERATOR_MEASURES = {
    "completion_s": "completion time (s)",
    "path_m": "path of the tool (m)",
    "reversals": "reversals",
}
_TURNS_M_S = 0.02  # a reversal: the tool goes so fast one way, and then so fast the other

Found = dict[str, dict[str, dict[str, Any]]]
"""By network, seed and variant, what was measured."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """What differs, and what is measured.

    variants: names of the two, the one compared with first. config_of: of a network, a variant and
    a seed. measures: of the folder of a trial, what the difference is taken of. words: by measure,
    what it is called. make_runs: what runs the configurations.
    """

    networks: Sequence[str]
    variants: tuple[str, str]
    config_of: Callable[[str, str, int], Config]
    measures: Callable[[Path], dict[str, Any]]
    words: Mapping[str, str]
    make_runs: Callable[[Mapping[str, Config]], VirtualRuns] = VirtualRuns

    def main(self, description: str | None, console: Console) -> Found:
        """Run what the command line asks for, and print the table of differences."""
        parser = argparse.ArgumentParser(description=description)
        parser.add_argument("--seeds", type=int, default=12)
        parser.add_argument("--network", choices=self.networks, action="append")
        parser.add_argument("--processes", type=int, default=2)
        parser.add_argument("--json", type=Path)
        options = parser.parse_args()
        seeds = range(1, options.seeds + 1)
        networks = options.network or self.networks
        found = self.run(networks, seeds, options.processes, options.json, console)
        console.print(self.table(found))
        return found

    def run(
        self,
        networks: Sequence[str],
        seeds: range,
        processes: int,
        kept: Path | None,
        console: Console,
    ) -> Found:
        """What was measured; the file `kept` is read and written."""
        found: Found = {}
        if kept is not None and kept.exists():
            found = json.loads(kept.read_text(encoding="utf-8"))
        missing = [
            (network, seed)
            for seed in seeds
            for network in networks
            if str(seed) not in found.get(network, {})
        ]
        with TrialsProgress(console, len(self.variants) * len(missing)) as bar:
            for first in range(0, len(missing), processes):
                batch = missing[first : first + processes]
                with tempfile.TemporaryDirectory() as folder:
                    configs = {
                        f"{network}-{variant}-{seed}": self.config_of(network, variant, seed)
                        for network, seed in batch
                        for variant in self.variants
                    }
                    out, ended = Path(folder), bar.trial_ended
                    run_side_by_side(configs, out, processes, ended, self.make_runs)
                    for network, seed in batch:
                        found.setdefault(network, {})[str(seed)] = {
                            variant: self.measures(out / f"{network}-{variant}-{seed}")
                            for variant in self.variants
                        }
                if kept is not None:
                    kept.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return found

    def table(self, found: Found) -> Table:
        """Means over the pairs that have both, and their differences."""
        first, second = self.variants
        shown = Table("network", "measure", first, second, "difference", "pairs", box=None)
        for network, trials in found.items():
            placed = [
                sum(one[variant]["success"] for one in trials.values()) for variant in self.variants
            ]
            placed_words = [f"{count} of {len(trials)}" for count in placed]
            shown.add_row(network, "placed", *placed_words, "", str(len(trials)))
            for measure, words in self.words.items():
                without, with_it = (
                    pd.Series({seed: one[variant][measure] for seed, one in trials.items()}).astype(
                        float
                    )
                    for variant in self.variants
                )
                shown.add_row(network, words, *_compared(without, with_it))
        return shown


def operator_measures(folder: Path, log: SessionLog) -> dict[str, Any]:
    """What the operator achieved in a trial, and how they moved; what it has not is None."""
    outcome = read_summary(folder)["outcome"]
    success = bool(outcome["success"])
    return {
        "success": success,
        "completion_s": outcome["completion_time_s"] if success else None,
        **motion(log),
    }


def motion(log: SessionLog) -> dict[str, float]:
    """How far the tool went, and how often it turned round along an axis, as it was commanded."""
    times_s = np.array([tick.started_ns for tick in log.ticks]) / NS_PER_S
    twists_m_s = np.array([tick.twist.linear for tick in log.ticks])
    path_m = float((np.linalg.norm(twists_m_s[:-1], axis=1) * np.diff(times_s)).sum())
    reversals = 0
    for along in twists_m_s.T:
        signs = np.sign(along[np.abs(along) > _TURNS_M_S])
        reversals += int((np.diff(signs) != 0).sum())
    return {"path_m": path_m, "reversals": float(reversals)}


def _compared(off: pd.Series, on: pd.Series) -> tuple[str, ...]:
    """Means of the pairs that have both, their difference with its interval, and how many."""
    both = off.notna() & on.notna()
    difference = paired_difference(on, off)
    estimate = difference.estimate
    words = "" if estimate is None else f"{estimate.value:+.3f}"
    if estimate is not None and estimate.low is not None:
        words += (
            f" [{estimate.low:+.3f}, {estimate.high:+.3f}]{'' if difference.is_shown else ' ns'}"
        )
    return f"{off[both].mean():.3f}", f"{on[both].mean():.3f}", words, str(difference.pairs)

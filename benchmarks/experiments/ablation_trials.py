"""The trials of the ablation: which there are, running them, and what each measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.experiments.ablation_cells import (
    Cell,
    configure,
    every,
    one_at_a_time,
    product_cell,
)
from benchmarks.experiments.ablation_table import Figures
from benchmarks.experiments.recorded_motion import record_hand
from benchmarks.experiments.virtual_runs import read_encoding_ms, read_summary, run_side_by_side
from tams_app.config import Config, load_config
from tams_app.recording import read_ticks
from tams_app.study.unattended import TrialsProgress
from tams_app.units import NS_PER_S

_LATER_S = 5.0  # a replay may end so long after its recording


@dataclass(frozen=True, slots=True)
class Trial:
    """One cell on one network with one seed."""

    network: str
    cell: Cell
    seed: int
    config: Config


def plan(networks: Iterable[str], hands: Mapping[int, Path], full: bool) -> dict[str, Trial]:
    """All trials by their ids."""
    trials: dict[str, Trial] = {}
    lengths_s = {seed: length_s(hand) for seed, hand in hands.items()}
    for network in networks:
        cells = list(every() if full else one_at_a_time(product_cell(network)))
        for seed, hand in hands.items():
            for cell in cells:
                config = configure(cell, network, seed, hand, lengths_s[seed] + _LATER_S)
                trials[f"trial-{len(trials):04d}"] = Trial(network, cell, seed, config)
    return trials


def record_hands(seeds: int, out: Path) -> dict[int, Path]:
    """A hand for each seed; TamsError if one fails."""
    hands = {seed: out / f"hand-{seed}.mcap" for seed in range(seeds)}
    for seed, path in hands.items():
        record_hand(load_config(None, {"seed": seed}), path)
    return hands


def run(
    trials: Mapping[str, Trial], out: Path, processes: int, bar: TrialsProgress
) -> dict[str, Figures]:
    """Every trial's figures by its id; TamsError if one fails."""
    configs = {name: trial.config for name, trial in trials.items()}
    run_side_by_side(configs, out, processes, bar.trial_ended)
    return {name: figures(out / name) for name in trials}


def figures(folder: Path) -> dict[str, float | None]:
    """What the table shows of one trial; latency and freezes are over all views."""
    summary = read_summary(folder)
    views = list(summary["views"].values())
    primary, uplink, outcome = summary["primary_view"], summary["uplink"], summary["outcome"]
    return {
        **{kind: primary[kind] for kind in ("received_ssim", "delivered_ssim", "live_ssim")},
        "latency_p50_ms": _mean(view["latency_ms"]["p50"] for view in views),
        "latency_p95_ms": _mean(view["latency_ms"]["p95"] for view in views),
        "frozen_s": sum(view["freezes"]["total_s"] or 0.0 for view in views),
        "residual_loss": uplink["residual_loss_fraction"],
        "sent_kbps": uplink["sent_kbps_mean"],
        "encoding_cpu_ms": read_encoding_ms(folder),
        "success": float(bool(outcome["success"])),
        "completion_time_s": outcome["completion_time_s"],
        "phases_missing": float(len(primary["missing_phases"])),
    }


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def length_s(hand: Path) -> float:
    """How long a recorded hand moves [s]."""
    *_, last = (tick.started_ns for tick in read_ticks(hand))
    return (last - next(read_ticks(hand)).started_ns) / NS_PER_S

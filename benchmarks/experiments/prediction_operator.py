"""Whether the predictive display helps the simulated operator: paired trials in virtual time.

`python -m benchmarks.experiments.prediction_operator` runs scene and participant of each seed with
`view.predict` off and on, over the study's networks and three that are far, with the real encoders.
The operator looks at what is shown. `--json FILE` keeps each pair as soon as it has been run; pairs
that it has already are not run again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.virtual_runs import read_summary, run_side_by_side
from tams_app.config import Config, Network, load_config
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.study.statistics.estimates import paired_difference
from tams_app.study.unattended import TrialsProgress
from tams_app.units import NS_PER_S

PREDICT = ("off", "eih")
_FAR = ((100.0, 25.0), (200.0, 30.0), (400.0, 50.0))
NETWORKS: dict[str, Network | None] = {
    **dict.fromkeys(("s1", "s2", "s3")),
    **{
        f"{latency_ms:g}-{jitter_ms:g}": Network(
            latency_ms=latency_ms, jitter_ms=jitter_ms, loss=0.001, rate_kbps=6000.0
        )
        for latency_ms, jitter_ms in _FAR
    },
}
MEASURES = {
    "completion_s": "completion time (s)",
    "path_m": "path of the tool (m)",
    "reversals": "reversals",
    "eih": "live SSIM, eih",
    "gt": "live SSIM, gt",
    "gs": "live SSIM, gs",
}
PHASES = ("REACH", "ALIGN", "GRASP", "TRANSPORT", "PRE_RELEASE")
_TURNS_M_S = 0.02  # a reversal: the tool goes so fast one way, and then so fast the other


def config_of(network: str, predict: str, seed: int) -> Config:
    given = NETWORKS[network]
    options: dict[str, Any] = {"network": network}
    if given is not None:
        options = {"network": "case", "networks.case": given.model_dump()}
    return load_config(
        None,
        {**options, "seed": seed, "view.predict": predict, "recording.bitstream": False},
    )


def measures(folder: Path) -> dict[str, Any]:
    """Of one trial; what it has not is None."""
    summary = read_summary(folder)
    outcome, views = summary["outcome"], summary["views"]
    log = read_log(folder / LOG_NAME)
    return {
        "success": bool(outcome["success"]),
        "completion_s": outcome["completion_time_s"] if outcome["success"] else None,
        **motion(log),
        **{view: views[view]["live_ssim"] for view in views},
        "phases": live_by_phase(log),
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


def live_by_phase(log: SessionLog) -> dict[str, dict[str, float]]:
    """By view and phase, the mean live SSIM of the frames that were captured in it."""
    times_ns = np.array([one.t_ns for one in log.phases])
    found: dict[str, dict[str, list[float]]] = {}
    for one in log.quality:
        place = int(np.searchsorted(times_ns, one.capture_ns, side="right")) - 1
        if one.live is not None and place >= 0:
            phase = log.phases[place].phase.value
            found.setdefault(one.view, {}).setdefault(phase, []).append(one.live)
    return {
        view: {phase: float(np.mean(live)) for phase, live in phases.items()}
        for view, phases in found.items()
    }


def run_pairs(
    networks: list[str], seeds: range, processes: int, kept: Path | None, console: Console
) -> dict[str, dict[str, dict[str, Any]]]:
    """By network and seed, the measures without and with; `kept` is read and written."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    if kept is not None and kept.exists():
        found = json.loads(kept.read_text(encoding="utf-8"))
    missing = [
        (network, seed)
        for seed in seeds
        for network in networks
        if str(seed) not in found.get(network, {})
    ]
    with TrialsProgress(console, len(PREDICT) * len(missing)) as bar:
        for first in range(0, len(missing), processes):
            batch = missing[first : first + processes]
            with tempfile.TemporaryDirectory() as folder:
                configs = {
                    f"{network}-{predict}-{seed}": config_of(network, predict, seed)
                    for network, seed in batch
                    for predict in PREDICT
                }
                run_side_by_side(configs, Path(folder), processes, bar.trial_ended)
                for network, seed in batch:
                    found.setdefault(network, {})[str(seed)] = {
                        predict: measures(Path(folder) / f"{network}-{predict}-{seed}")
                        for predict in PREDICT
                    }
            if kept is not None:
                kept.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return found


def pairs_table(found: dict[str, dict[str, dict[str, Any]]]) -> Table:
    shown = Table("network", "measure", "off", "predicted", "difference", "pairs", box=None)
    for network, trials in found.items():
        placed = [sum(one[predict]["success"] for one in trials.values()) for predict in PREDICT]
        placed_words = [f"{count} of {len(trials)}" for count in placed]
        shown.add_row(network, "placed", *placed_words, "", str(len(trials)))
        for measure, words in MEASURES.items():
            off, on = (
                pd.Series({seed: one[predict][measure] for seed, one in trials.items()}).astype(
                    float
                )
                for predict in PREDICT
            )
            shown.add_row(network, words, *_compared(off, on))
    return shown


def phases_table(found: dict[str, dict[str, dict[str, Any]]]) -> Table:
    shown = Table("network", "view", *PHASES, title="live SSIM, off → predicted", box=None)
    for network, trials in found.items():
        for view in ("eih", "gt", "gs"):
            cells = []
            for phase in PHASES:
                both = [
                    [one[predict]["phases"][view].get(phase) for one in trials.values()]
                    for predict in PREDICT
                ]
                off, on = (_mean([one for one in row if one is not None]) for row in both)
                cells.append(f"{off} → {on}")
            shown.add_row(network, view, *cells)
    return shown


def _mean(values: list[float]) -> str:
    return f"{np.mean(values):.3f}" if values else "–"


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--network", choices=NETWORKS, action="append")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console()
    found = run_pairs(
        options.network or list(NETWORKS),
        range(1, options.seeds + 1),
        options.processes,
        options.json,
        console,
    )
    console.print(pairs_table(found))
    console.print(phases_table(found))


if __name__ == "__main__":
    main()

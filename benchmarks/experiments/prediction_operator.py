"""Whether the predictive display helps the simulated operator: paired trials in virtual time.

`python -m benchmarks.experiments.prediction_operator` runs scene and participant of each seed with
`view.predict` off and on, over the study's networks and three that are far, with the real encoders.
The operator looks at what is shown. `--json FILE` keeps each pair as soon as it has been run; pairs
that it has already are not run again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.experiments.operator_pairs import (
    OPERATOR_MEASURES,
    Found,
    Pairs,
    operator_measures,
)
from benchmarks.experiments.virtual_runs import read_summary
from tams_app.config import Config, Network, load_config
from tams_app.recording import LOG_NAME, SessionLog, read_log

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
VIEWS = ("eih", "gt", "gs")
PHASES = ("REACH", "ALIGN", "GRASP", "TRANSPORT", "PRE_RELEASE")


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
    views = read_summary(folder)["views"]
    log = read_log(folder / LOG_NAME)
    return {
        **operator_measures(folder, log),
        **{view: views[view]["live_ssim"] for view in views},
        "phases": live_by_phase(log),
    }


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


def phases_table(found: Found) -> Table:
    shown = Table("network", "view", *PHASES, title="live SSIM, off → predicted", box=None)
    for network, trials in found.items():
        for view in VIEWS:
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


def main() -> None:
    words = {**OPERATOR_MEASURES, **{view: f"live SSIM, {view}" for view in VIEWS}}
    console = Console()
    found = Pairs(list(NETWORKS), PREDICT, config_of, measures, words).main(__doc__, console)
    console.print(phases_table(found))


if __name__ == "__main__":
    main()

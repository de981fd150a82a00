"""How well `calibrate cameras` finds what is true of the simulated rig's cameras.

`python -m benchmarks.camera_calibration [seeds]` prints the errors over that many seeds.
"""

from __future__ import annotations

import io
import sys

import numpy as np
from rich.console import Console

from calibration.cameras.binding import bind_views
from calibration.cameras.findings import Findings
from calibration.cameras.image_steps import measure_latency
from calibration.cameras.simulated_bench import SimulatedBench
from calibration.ui import WizardUI
from tams_app.config import Config, load_config


def measure(config: Config, seed: int, errors: dict[str, list[float]]) -> None:
    """Add what one seed's cameras were mistaken by: [ms], and latencies over their stated error."""
    bench, ui = SimulatedBench(config, seed), WizardUI(Console(file=io.StringIO()))
    cameras = bind_views(ui, bench, config.video.views)
    errors["wrong view"] += [float(bench.truth[c].view != view) for view, c in cameras.items()]
    found = [Findings(view, camera) for view, camera in cameras.items()]
    measure_latency(ui, bench, found)
    for each in found:
        if each.latency is not None:
            error = each.latency.ms - bench.truth[each.camera].latency_ms
            errors["latency"].append(error)
            errors["latency, over its error"].append(error / each.latency.error_ms)


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    errors: dict[str, list[float]] = {
        "wrong view": [],
        "latency": [],
        "latency, over its error": [],
    }
    config = load_config()
    for seed in range(seeds):
        measure(config, seed, errors)
    for name, values in errors.items():
        rms, worst = np.sqrt(np.mean(np.square(values))), np.max(np.abs(values))
        print(f"{name}: rms {rms:.2f}, worst {worst:.2f}, n = {len(values)}")


if __name__ == "__main__":
    main()

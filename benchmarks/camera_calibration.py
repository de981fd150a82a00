"""How well `calibrate cameras` finds what is true of the simulated rig's cameras.

`python -m benchmarks.camera_calibration [seeds]` prints the errors over that many seeds.
"""

from __future__ import annotations

import sys

import numpy as np

from calibration.cameras.bench import Task
from calibration.cameras.board import Board
from calibration.cameras.findings import Findings
from calibration.cameras.latency_step import measure_offsets_by_light, read_screens
from calibration.cameras.simulated_bench import SimulatedBench
from calibration.cameras.which_step import bind_views
from calibration.desk import PlayedDesk
from tams_app.config import Config, load_config
from tams_app.runtime.clock import MonotonicClock

_RING_S = 9.0


def measure(config: Config, seed: int, errors: dict[str, list[float]]) -> None:
    """Add what one seed's cameras were mistaken by: [ms], and offsets over their stated error."""
    bench, desk = SimulatedBench(config, seed, MonotonicClock(), Board()), PlayedDesk()
    cameras = bind_views(desk, bench, config.video.views)
    errors["wrong view"] += [float(bench.truth[c].view != view) for view, c in cameras.items()]
    found = [Findings(view, camera) for view, camera in cameras.items()]
    for each in found:
        bench.prompt(Task.FOCUS, each.view)
        for _ in bench.shots([each.camera], _RING_S, every=30):
            pass
    true_ms = {each.view: bench.truth[each.camera].latency_ms for each in found}
    first = true_ms[found[0].view]
    read_screens(desk, bench, found)
    for each in found:
        if each.to_capture is not None:
            errors["light to capture"].append(each.to_capture.median_ms - true_ms[each.view])
    for name, again in (("screen", False), ("light", True)):
        if again:
            measure_offsets_by_light(desk, bench, found)
        for each in found[1:]:
            if each.offset is not None:
                error = each.offset.ms - (true_ms[each.view] - first)
                errors[f"offset by {name}"].append(error)
                errors[f"offset by {name}, over its error"].append(error / each.offset.error_ms)


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    errors: dict[str, list[float]] = {
        "wrong view": [],
        "light to capture": [],
        "offset by screen": [],
        "offset by screen, over its error": [],
        "offset by light": [],
        "offset by light, over its error": [],
    }
    config = load_config()
    for seed in range(seeds):
        measure(config, seed, errors)
    for name, values in errors.items():
        rms, worst = np.sqrt(np.mean(np.square(values))), np.max(np.abs(values))
        print(f"{name}: rms {rms:.2f}, worst {worst:.2f}, n = {len(values)}")


if __name__ == "__main__":
    main()

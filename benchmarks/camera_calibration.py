"""How well `calibrate cameras` finds what is true of the simulated rig's cameras.

`python -m benchmarks.camera_calibration [seeds]` prints the errors over that many seeds.
"""

from __future__ import annotations

import io
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np
from rich.console import Console

from calibration.cameras.binding import bind_views
from calibration.cameras.board import Board
from calibration.cameras.board_steps import measure_lens, measure_mounts
from calibration.cameras.findings import Findings
from calibration.cameras.image_steps import measure_latency
from calibration.cameras.simulated_bench import SimulatedBench
from calibration.ui import WizardUI
from hw.arms import arm_kind
from hw.sim.viewpoints import HEIGHT_PX, WIDTH_PX
from tams_app.config import Config, load_config
from tams_app.prediction.plane_warp import projected
from tams_app.records import Lens
from tams_app.session.lenses import WRIST_VIEW

BENT = {"eih": (-0.25, 0.06, 0.001, -0.001, 0.0), "gs": (0.08, 0.02, 0.0, 0.0, 0.0)}
DISTANCE_M = {"arm": 0.25, "base": 0.87}  # from a camera to where one works


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


def measure_board(config: Config, seed: int, errors: dict[str, list[float]]) -> None:
    """The same of lenses and mounts, of cameras of which two distort."""
    bench, ui = SimulatedBench(config, seed, BENT), WizardUI(Console(file=io.StringIO()))
    found = [Findings(truth.view, camera) for camera, truth in bench.truth.items()]
    for each in found:
        measure_lens(ui, bench, Board(), each)
    lenses = {each.view: each.lens.lens for each in found if each.lens is not None}
    measure_mounts(ui, bench, Board(), found, lenses, arm_kind(config.arm.model).figure())
    bench.close()
    for each in found:
        true = bench.lenses[each.view]
        errors["lens or mount not found"].append(float(each.lens is None or each.mount is None))
        if each.lens is None or each.mount is None:
            continue
        lens = replace(each.lens.lens, pose=each.mount.pose)
        where = "arm" if each.view == WRIST_VIEW else "base"
        errors["focal length [%]"].append(100.0 * (lens.fx / true.fx - 1.0))
        apart = float(np.linalg.norm(lens.pose.position - true.pose.position))
        turned = (lens.pose.rotation.inv() * true.pose.rotation).magnitude()
        off_px = predicted_off_px(lens, true, DISTANCE_M[where])
        errors[f"mount, {where} [mm]"].append(1000.0 * apart)
        errors[f"mount, {where} [degrees]"].append(float(np.degrees(turned)))
        errors[f"mount, {where}: points where one works [px]"].append(off_px)
        errors[f"mount, {where}: those over the stated error"].append(off_px / each.mount.error_px)


def predicted_off_px(found: Lens, true: Lens, distance_m: float) -> float:
    """How far points at a distance are from where they are in the picture, rms over it [px]."""
    across, down = np.linspace(20, WIDTH_PX - 21, 12), np.linspace(20, HEIGHT_PX - 21, 9)
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = np.insert(true.slopes(pixels), 2, 1.0, axis=1) * distance_m
    points = true.pose.position + true.pose.rotation.apply(rays)
    off = projected(points, found) - pixels
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    errors: dict[str, list[float]] = defaultdict(list)
    config = load_config()
    for seed in range(seeds):
        measure(config, seed, errors)
        measure_board(config, seed, errors)
    for name, values in errors.items():
        rms, worst = np.sqrt(np.mean(np.square(values))), np.max(np.abs(values))
        print(f"{name}: rms {rms:.2f}, worst {worst:.2f}, n = {len(values)}")


if __name__ == "__main__":
    main()

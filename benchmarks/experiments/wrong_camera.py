"""How wrong the pose or lens of the camera on the arm must be until the predictive display sees it.

`python -m benchmarks.experiments.wrong_camera` runs trials in virtual time, five seeds over each of
two latencies, at 10 frames a second, and gives the frames and states that the operator's side
receives to the product's `CameraCheck`, once with the right camera and once with each wrong one.
What it decides by is the share of the dissimilarity (1 - SSIM) of two frames that is left when the
earlier is drawn as from where the later was captured, over five comparisons: here over all runs of
five, and in how many trials any of them is above the product's limit. Frames that are mirrored are
checked with the right camera.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from tams_app.config import Config, Network, load_config
from tams_app.prediction import camera_check
from tams_app.prediction.camera_check import COMPARED, WORST, CameraCheck
from tams_app.prediction.cameras import PredictedCamera
from tams_app.prediction.present import MountTrail, WristView
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Lens, MountPrediction, Pose, ShownFrame
from tams_app.rotation import Rotation
from tams_app.session.viewing import scene_of
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.vectors import ZERO, Floats3

VIEW = "eih"
ONE_WAY_MS = (40.0, 400.0)
TRIAL_S, FPS = 20.0, 10
RIGHT, MIRRORED = "right", "mirrored frames"
WALL_NS = 1_800_000_000_000_000_000
Lefts = dict[str, list[float]]


def cameras_of(lens: Lens) -> dict[str, Lens]:
    """The right one and wrong ones, by what is wrong."""
    found = {RIGHT: lens, MIRRORED: lens}
    for axis, name in ((2, "rolled"), (0, "tilted"), (1, "panned")):
        for turn_deg in (-15.0, -10.0, -5.0, 5.0, 10.0, 15.0):
            turn = [0.0, 0.0, 0.0]
            turn[axis] = turn_deg
            found[f"{name} {turn_deg:+g}°"] = moved(lens, turn=(turn[0], turn[1], turn[2]))
    found["upside down"] = moved(lens, turn=(0.0, 0.0, 180.0))
    for axis, name in ((2, "forwards"), (1, "down"), (0, "to the right")):
        for move_mm in (-50.0, -30.0, 30.0, 50.0, 100.0):
            move = [0.0, 0.0, 0.0]
            move[axis] = move_mm / 1000.0
            found[f"{name} {move_mm:+g} mm"] = moved(lens, (move[0], move[1], move[2]))
    for percent in (-30, -20, -10, 10, 20, 30):
        times = 1.0 + percent / 100.0
        longer = replace(lens, fx=times * lens.fx, fy=times * lens.fy)
        found[f"focal length {percent:+d} %"] = longer
    return found


def moved(lens: Lens, move: Floats3 = ZERO, turn: Floats3 = ZERO) -> Lens:
    """The camera moved [m] and turned [degrees], in its own axes."""
    pose = lens.pose
    position = pose.position + pose.rotation.apply(np.array(move))
    turned = pose.rotation * Rotation.from_rotvec(tuple(np.radians(turn)))
    return replace(lens, pose=Pose(position, turned))


def watched(config: Config) -> tuple[list[ShownFrame], list[MountPrediction]]:
    """What of one trial came to the operator's side: the wrist view's frames, the states."""
    frames: list[ShownFrame] = []

    def watch(shown: ShownFrame) -> None:
        if shown.view == VIEW:
            frames.append(shown)

    with tempfile.TemporaryDirectory() as name:
        with closing(VirtualTrial(config, 0, Path(name), WALL_NS, watch)) as trial:
            trial.run()
        return frames, read_log(Path(name) / LOG_NAME).predictions


def lefts_of(seed: int, one_way_ms: float) -> Lefts:
    """By camera, what was left in each run of five comparisons of one trial."""
    cv2.setNumThreads(1)
    config = load_config(
        None,
        {
            "networks.case": Network(latency_ms=one_way_ms, rate_kbps=12_000.0).model_dump(),
            "network": "case",
            "seed": seed,
            "seconds": TRIAL_S,
            "video.fps": FPS,
            "video.quality.enabled": False,
            "view.predict": "eih",
            "rig.operator.looks_at": "received",
            "recording.bitstream": False,
        },
    )
    frames, predictions = watched(config)
    scene = scene_of(config)
    assert scene.figure is not None
    tool, grip = scene.figure.solids[scene.figure.flange], scene.figure.grip
    trail = MountTrail()
    checks = {}
    for name, lens in cameras_of(scene.lenses[VIEW]).items():
        view = PredictedCamera.of(lens, tool, grip).view(trail)
        assert isinstance(view, WristView)
        checks[name] = CameraCheck(view)
    lefts: Lefts = {name: [] for name in checks}
    waiting = iter([*predictions, None])
    newest = next(waiting)
    with patch.object(camera_check, "WORST", math.inf):
        for frame in frames:
            while newest is not None and newest.now_ns <= frame.shown_ns:
                trail.add(newest)
                newest = next(waiting)
            flipped = replace(frame, image=np.asarray(cv2.flip(frame.image, 1), np.uint8))
            for name, check in checks.items():
                before = check.judged
                check.shown(flipped if name == MIRRORED else frame)
                if check.judged > max(before, COMPARED - 1) and check.left is not None:
                    lefts[name].append(check.left)
    return lefts


def table(found: Mapping[str, Lefts]) -> Table:
    """By camera, over all trials that had a run of five comparisons."""
    shown = Table("camera", "left p50", "least", "most", f"noticed (above {WORST:g})", box=None)
    for name, trials in by_camera(found).items():
        every = [left for lefts in trials for left in lefts]
        noticed = sum(max(lefts) > WORST for lefts in trials)
        figures = (f"{one:.2f}" for one in (np.median(every), min(every), max(every)))
        shown.add_row(name, *figures, f"{noticed} of {len(trials)} trials")
    return shown


def by_camera(found: Mapping[str, Lefts]) -> dict[str, list[list[float]]]:
    """What was left in each trial that had a run of five comparisons."""
    cameras: dict[str, list[list[float]]] = {}
    for trial in found.values():
        for name, lefts in trial.items():
            if lefts:
                cameras.setdefault(name, []).append(lefts)
    return cameras


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console()
    console.width = max(console.width, 100)
    cases = list(product(range(1, options.seeds + 1), ONE_WAY_MS))
    found: dict[str, Lefts] = {}
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        trials = pool.map(lefts_of, *zip(*cases, strict=True))
        for (seed, one_way_ms), lefts in zip(cases, trials, strict=True):
            found[f"seed {seed}, {one_way_ms:g} ms"] = {
                name: [round(left, 3) for left in each] for name, each in lefts.items()
            }
            console.print(f"seed {seed}, {one_way_ms:g} ms: {len(lefts[RIGHT])} decisions")
            if options.json:
                options.json.write_text(json.dumps(found) + "\n", encoding="utf-8")
    console.print(table(found))
    without = [name for name, lefts in found.items() if not lefts[RIGHT]]
    console.print(f"{len(found)} trials; without five comparisons: {', '.join(without) or 'none'}")


if __name__ == "__main__":
    main()

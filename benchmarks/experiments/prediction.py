"""How much of the present a late eye-in-hand frame shows, corrected in different ways.

`python -m benchmarks.experiments.prediction` lets a participant with perfect eyes carry the block
in virtual time, one trial for each seed, and looks at the moving parts as an operator would for
whom frame, state and samples are late: by the one-way latency, the frame by 45 ms more and the
state by 5 ms more. First, how far from the truth the arm's TCP is believed to be now: by the newest
state, by that state extrapolated at its own speed, by the forward model. Then the similarity (SSIM)
of the frame to the one that the camera takes now: as it is, and warped to each of those poses, and
to the true one. Frames are free of coding and loss. `--picture FILE` draws one instant.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.experiments.prediction_instants import FRAME_MS, Recorded, instants
from benchmarks.experiments.prediction_pictures import VIEW, Artist
from hw.arms import arm_kind
from hw.sim.layout import draw_layout
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app.config import Config, load_config
from tams_app.prediction.plane_warp import WristWarp
from tams_app.records import Image, Pose, Vector
from tams_app.session.viewing import scene_of
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim

ONE_WAY_MS = (40.0, 100.0, 200.0, 400.0)
BELIEFS = ("as received", "newest state", "extrapolated", "forward model", "true pose")


@dataclass(frozen=True, slots=True)
class Measured:
    """Of all instants at one latency, by belief: errors [mm, degrees] and similarities."""

    away_mm: dict[str, list[float]]
    turned_deg: dict[str, list[float]]
    similar: dict[str, list[float]]
    unseen: list[float]


def measure(config: Config, trial: Recorded, seed: int, found: dict[float, Measured]) -> None:
    """Add a trial's instants."""
    kind, scene = arm_kind(config.arm.model), scene_of(config)
    kinematics, figure = kind.kinematics(config.arm), scene.figure
    assert figure is not None
    warp = WristWarp(scene.lenses[VIEW], figure.solids[figure.flange], figure.grip)

    def flange(joints: Vector) -> Pose:
        return figure.place(joints)[figure.flange]

    renderer = SceneRenderer(draw_layout(seed))
    for one_way_ms, measured in found.items():
        for instant in instants(config, trial, one_way_ms):
            true = kinematics.tcp_pose(instant.believed["true pose"])
            for name, joints in instant.believed.items():
                pose = kinematics.tcp_pose(joints)
                away_m = float(np.linalg.norm(pose.position - true.position))
                measured.away_mm[name].append(away_m * 1000)
                turn = (pose.rotation * true.rotation.inv()).magnitude()
                measured.turned_deg[name].append(float(np.degrees(turn)))
            late = renderer.render(VIEW, trial.world.at(instant.frame_ns))
            present = FrameMoments.of(
                luma_of(renderer.render(VIEW, trial.world.at(instant.now_ns)))
            )
            measured.similar["as received"].append(_similar(late, present))
            then = flange(instant.frame_joints)
            for name, joints in instant.believed.items():
                warped = warp.to_now(late, then, flange(joints), instant.closed)
                shown = late if warped is None else warped.image
                measured.similar[name].append(_similar(shown, present))
                if name == "forward model" and warped is not None:
                    measured.unseen.append(warped.unseen)
    renderer.close()


def _similar(image: Image, present: FrameMoments) -> float:
    return ssim(present, FrameMoments.of(luma_of(image)))


def errors_table(found: dict[float, Measured]) -> Table:
    shown = Table("one way", "TCP from the truth, by", "mm p50", "p95", "degrees p50", "p95",
                  box=None)  # fmt: skip
    for one_way_ms, measured in found.items():
        for name, away in measured.away_mm.items():
            figures = (*_quantiles(away), *_quantiles(measured.turned_deg[name]))
            shown.add_row(f"{one_way_ms:g} ms", name, *(f"{value:.2f}" for value in figures))
    return shown


def similarity_table(found: dict[float, Measured]) -> Table:
    shown = Table("one way", "frame old", *BELIEFS, "not seen", "instants", box=None)
    for one_way_ms, measured in found.items():
        cells = [f"{np.mean(measured.similar[name]):.3f}" for name in BELIEFS]
        shown.add_row(f"{one_way_ms:g} ms", f"{one_way_ms + FRAME_MS:g} ms", *cells,
                      f"{np.mean(measured.unseen):.1%}", str(len(measured.similar["as received"]))
                      )  # fmt: skip
    return shown


def _quantiles(values: Sequence[float]) -> NDArray[np.float64]:
    return np.asarray(np.percentile(values, (50, 95)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--picture", type=Path, help="of the last seed, at 100 ms one way")
    options = parser.parse_args()
    config = load_config(overrides={"rig.enabled": True})
    console = Console()
    console.width = max(console.width, 130)
    beliefs = BELIEFS[1:]
    found = {
        one_way_ms: Measured(
            {name: [] for name in beliefs},
            {name: [] for name in beliefs},
            {name: [] for name in BELIEFS},
            [],
        )
        for one_way_ms in ONE_WAY_MS
    }
    for seed in track(range(1, options.seeds + 1), "trials", console=console, transient=True):
        trial = Recorded(config, seed)
        for _seconds in trial.perform():
            pass
        measure(config, trial, seed, found)
    console.print(errors_table(found))
    console.print(similarity_table(found))
    if options.picture:
        artist = Artist(config, trial, seed)
        most = max(instants(config, trial, 100.0), key=artist.moved_m)
        cv2.imwrite(str(options.picture), artist.draw(most))
        artist.close()
    if options.json:
        told = {
            f"{one_way_ms:g}": {
                "similarity": {name: float(np.mean(one.similar[name])) for name in BELIEFS},
                "away_mm": {name: list(_quantiles(one.away_mm[name])) for name in beliefs},
                "turned_deg": {name: list(_quantiles(one.turned_deg[name])) for name in beliefs},
                "unseen": float(np.mean(one.unseen)),
                "instants": len(one.unseen),
            }
            for one_way_ms, one in found.items()
        }
        options.json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

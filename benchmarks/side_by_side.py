"""docs/side-by-side.webp: Equal and TAMS on network s3, as the operator sees both.

`python -m benchmarks.side_by_side [--seed N]` records a hand, replays it in virtual time with each
strategy (everything else is the default), and shows ten seconds around the alignment: of each view
the same part of the frames, one pixel for each pixel received, with its target at that moment.
"""

from __future__ import annotations

import math
import tempfile
from argparse import ArgumentParser
from bisect import bisect_right
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.experiments.recorded_motion import record_hand
from hw.sim.layout import draw_layout
from hw.sim.viewpoints import FIXED_VIEWPOINTS, HEIGHT_PX, WIDTH_PX, FixedViewpoint
from tams_app.config import load_config
from tams_app.palette import rgb, view_colour
from tams_app.policy.weights import WeightMatrix
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Image, Phase, ShownFrame
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.units import NS_PER_S

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "side-by-side.webp"
NETWORK, STRATEGIES = "s3", {"equal": "Equal", "tams": "TAMS"}
BEFORE_S, LENGTH_S, FPS = 3.0, 10.0, 10
SIZE = (272, 204)  # of a part, width and height [px]
WRIST_CENTRE = (320, 230)  # of the wrist camera's part [px]
LIFT_M = 0.04  # the other parts' centres are so far above the block, where the gripper comes
GAP, HEAD = 6, 24  # [px]
BACKGROUND, INK = (40, 40, 40), (235, 235, 235)
QUALITY = 80  # of WebP
WALL_NS = 1_800_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class Seen:
    """What one trial showed: of each view when, and the part of the frame."""

    log: SessionLog
    times_ns: dict[str, list[int]]
    parts: dict[str, list[Image]]

    def part(self, view: str, t_ns: int) -> Image:
        """What is on the screen at `t_ns`; black before the first frame."""
        number = bisect_right(self.times_ns[view], t_ns) - 1
        if number < 0:
            return np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        return self.parts[view][number]

    def phase(self, t_ns: int) -> Phase:
        """In force at `t_ns`."""
        return next(c.phase for c in reversed(self.log.phases) if c.t_ns <= t_ns)

    def targets_kbps(self, t_ns: int) -> dict[str, int]:
        """In force at `t_ns`."""
        allocations = self.log.allocations
        return allocations[bisect_right(allocations, t_ns, key=lambda a: a.t_ns) - 1].target_kbps


def watched(strategy: str, seed: int, hand: Path, folder: Path) -> Seen:
    """One replay of `hand`, and what of it was shown."""
    config = load_config(
        None,
        {
            "strategy": strategy,
            "network": NETWORK,
            "seed": seed,
            "rig.hand_trajectory": str(hand),
            "recording.bitstream": False,
        },
    )
    centres = {"eih": WRIST_CENTRE} | {
        view: pixel_of(viewpoint, seed) for view, viewpoint in FIXED_VIEWPOINTS.items()
    }
    times_ns: dict[str, list[int]] = {view: [] for view in config.video.views}
    parts: dict[str, list[Image]] = {view: [] for view in config.video.views}

    def watch(shown: ShownFrame) -> None:
        times_ns[shown.view].append(shown.shown_ns)
        parts[shown.view].append(_part(shown.image, *centres[shown.view]))

    folder.mkdir()
    with closing(VirtualTrial(config, 0, folder, WALL_NS, watch)) as trial:
        print(f"{strategy}: {trial.run()}", flush=True)
    return Seen(read_log(folder / LOG_NAME), times_ns, parts)


def pixel_of(viewpoint: FixedViewpoint, seed: int) -> tuple[int, int]:
    """Where in the image it is that the gripper comes to take the block, column and row."""
    block = draw_layout(seed).block
    seen = viewpoint.axes().T @ np.subtract((block.x, block.y, LIFT_M), viewpoint.place)
    focal_px = HEIGHT_PX / 2 / math.tan(math.radians(viewpoint.fovy_deg) / 2)
    column, row = seen[:2] / seen[2] * focal_px
    return round(WIDTH_PX / 2 + column), round(HEIGHT_PX / 2 + row)


def _part(image: Image, x: int, y: int) -> Image:
    width, height = SIZE
    left = min(max(0, x - width // 2), image.shape[1] - width)
    top = min(max(0, y - height // 2), image.shape[0] - height)
    return image[top : top + height, left : left + width].copy()


def composed(trials: dict[str, Seen], t_ns: int) -> Image:
    """One picture: a row for each strategy, a column for each view."""
    views = list(next(iter(trials.values())).times_ns)
    width, height = SIZE
    cell_h = height + HEAD + GAP
    picture = np.full(
        (HEAD + cell_h * len(trials), GAP + (width + GAP) * len(views), 3), BACKGROUND, np.uint8
    )
    for row, (name, seen) in enumerate(trials.items()):
        phase, targets = seen.phase(t_ns), seen.targets_kbps(t_ns)
        primary = WeightMatrix(seen.log.header.weights).primary_view(phase)
        if row == 0:
            passed_s = (t_ns - seen.log.header.started_ns) / NS_PER_S
            _write(picture, f"{phase.value}   {passed_s:.1f} s   network {NETWORK}", GAP, 17)
        for column, view in enumerate(views):
            x, y = GAP + column * (width + GAP), HEAD + row * cell_h
            red, green, blue = rgb(view_colour(column))
            colour = (round(255 * blue), round(255 * green), round(255 * red))
            primary_word = "  primary" if view == primary else ""
            text = f"{name}  {view.upper()}  {targets[view]} kbit/s{primary_word}"
            _write(picture, text, x, y + 17)
            picture[y + HEAD : y + HEAD + height, x : x + width] = seen.part(view, t_ns)
            if view == primary:
                corner = (x + width, y + HEAD + height)
                cv2.rectangle(picture, (x - 2, y + HEAD - 2), corner, colour, 3)
    return picture


def _write(picture: Image, text: str, x: int, y: int) -> None:
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.46, INK, 1, cv2.LINE_AA)


def main() -> None:
    parser = ArgumentParser(prog="benchmarks.side_by_side", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the scene (default 0)")
    parser.add_argument("--out", type=Path, default=PICTURE)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hand = folder / "hand.mcap"
        record_hand(load_config(None, {"seed": options.seed}), hand)
        trials = {
            shown: watched(strategy, options.seed, hand, folder / strategy)
            for strategy, shown in STRATEGIES.items()
        }
    phases = next(iter(trials.values())).log.phases
    aligned_ns = next(change.t_ns for change in phases if change.phase is Phase.ALIGN)
    start_ns = aligned_ns - round(BEFORE_S * NS_PER_S)
    animation = cv2.Animation()
    animation.frames = [
        composed(trials, start_ns + number * NS_PER_S // FPS)
        for number in range(round(LENGTH_S * FPS))
    ]
    animation.durations = np.full(len(animation.frames), 1000 // FPS)
    cv2.imwriteanimation(str(options.out), animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

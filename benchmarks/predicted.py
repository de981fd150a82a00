"""Pictures of the predictive display: what came late, what is made of it, and what is there now.

`python -m benchmarks.predicted animation`: docs/predicted.webp, a simulated trial in virtual time
with the product's encoders, network and predictions: the wrist view as it was received, as
`view.predict` draws it at that moment, and as the camera sees it then. Above each of the first two
is its similarity (SSIM of the luma) to the third, at that moment and, in the command's output, over
all of them. It begins with the first motion.
`python -m benchmarks.predicted outline`: docs/outline.jpg, the fixed views of the same trial with
the outline of the arm, at the moment when what was received differs most from what is there.
"""

from __future__ import annotations

import tempfile
from argparse import ArgumentParser
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from tams_app.config import Config, Network, load_config
from tams_app.prediction.present import Correction, Shown
from tams_app.recording import LOG_NAME, read_log
from tams_app.recording.journal import Journal
from tams_app.records import Frame, Image, MountPrediction, ShownFrame
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.session.virtual.video import FrameScores
from tams_app.station.operator_screen import Show
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim

DOCS = Path(__file__).resolve().parent.parent / "docs"
WRIST, FIXED = "eih", ("gt", "gs")
ONE_WAY_MS, RATE_KBPS = 200.0, 12_000.0
LENGTH_S, EACH = 7.0, 3  # of the animation; each third of 30 captures a second
TRIAL_S = 16.0
SIZE = (320, 240)  # of a column, width and height [px]
PART = (480, 400)  # of a picture with an outline
HEAD, GAP = 26, 4  # [px]
BACKGROUND, INK = (40, 40, 40), (235, 235, 235)
QUALITY = 45  # of WebP
WALL_NS = 1_800_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class Moment:
    """A view when its camera took a frame: the newest that was received then, and that frame."""

    view: str
    index: int  # of the capture
    t_ns: int
    received: Image
    age_ms: float
    shown: Shown
    true: Image

    def similar(self, image: Image) -> float:
        """SSIM of the luma to what the camera sees."""
        true, other = (FrameMoments.of(luma_of(one)) for one in (self.true, image))
        return ssim(true, other)


class Watcher:
    """Keeps the moments of a trial."""

    def __init__(self) -> None:
        self.moments: list[Moment] = []
        self._shows: Mapping[str, Show] = {}
        self._newest: dict[str, ShownFrame] = {}

    def make_operator(
        self,
        config: Config,
        participant_seed: int,
        log: Journal,
        on_shown: Callable[[ShownFrame], None],
        shows: Mapping[str, Show],
    ) -> VirtualOperator:
        """The operator of a trial, who looks at what the moments keep."""
        self._shows = shows
        return VirtualOperator(config, participant_seed, log, on_shown, shows)

    def shown(self, frame: ShownFrame) -> None:
        """A frame was received."""
        self._newest[frame.view] = frame

    def captured(self, frame: Frame) -> None:
        """A frame was taken."""
        newest = self._newest.get(frame.view)
        if newest is None or frame.index % EACH:
            return
        now_ns = frame.capture_ns
        age_ms = (now_ns - newest.capture_ns) / NS_PER_MS
        shown = self._shows[frame.view](newest.image, newest.capture_ns, now_ns)
        moment = Moment(frame.view, frame.index, now_ns, newest.image, age_ms, shown, frame.image)
        self.moments.append(moment)


@dataclass(frozen=True, slots=True)
class Watched:
    """One trial with every view corrected, from when the arm first moves."""

    config: Config
    moments: list[Moment]
    predictions: list[MountPrediction]

    @property
    def furthest(self) -> dict[str, Moment]:
        """By view, when what was received of the fixed views differs most from what is there."""
        captures: dict[int, dict[str, Moment]] = {}
        for one in self.moments:
            if one.shown.correction is not None:
                captures.setdefault(one.index, {})[one.view] = one
        return max(
            (views for views in captures.values() if len(views) == len(self.config.video.views)),
            key=lambda views: sum(_apart(views[view].received, views[view].true) for view in FIXED),
        )


def watched(seed: int) -> Watched:
    """Let one pass."""
    network = Network(latency_ms=ONE_WAY_MS, rate_kbps=RATE_KBPS)
    config = load_config(
        None,
        {
            "networks.case": network.model_dump(),
            "network": "case",
            "seed": seed,
            "view.predict": "all",
            "seconds": TRIAL_S,
            "recording.bitstream": False,
        },
    )
    watcher = Watcher()
    with tempfile.TemporaryDirectory() as name:
        folder, make = Path(name), watcher.make_operator
        with (
            patch.object(FrameScores, "captured", lambda _, frame: watcher.captured(frame)),
            patch.object(FrameScores, "shown", lambda _, frame: watcher.shown(frame)),
            closing(VirtualTrial(config, 0, folder, WALL_NS, make_operator=make)) as trial,
        ):
            print(trial.run(), flush=True)
        predictions = read_log(folder / LOG_NAME).predictions
    moments = watcher.moments
    began_ns = next(one.t_ns for one in moments if one.shown.correction is Correction.OUTLINE)
    return Watched(config, [one for one in moments if one.t_ns >= began_ns], predictions)


def _apart(image: Image, other: Image) -> float:
    """Mean difference of the lumas."""
    return float(cv2.absdiff(luma_of(image), luma_of(other)).mean())


def animation(moments: list[Moment], path: Path) -> None:
    """The wrist view of the first seconds, as a loop in real time."""
    wrist = [one for one in moments if one.view == WRIST]
    wrist = [one for one in wrist if one.t_ns < wrist[0].t_ns + LENGTH_S * NS_PER_S]
    scores = np.array([(one.similar(one.received), one.similar(one.shown.image)) for one in wrist])
    predicted = [one.shown.correction is Correction.PREDICTED for one in wrist]
    film = cv2.Animation()
    film.frames = [columns(one, *pair) for one, pair in zip(wrist, scores, strict=True)]
    film.durations = [round((wrist[1].t_ns - wrist[0].t_ns) / NS_PER_MS)] * len(wrist)
    cv2.imwriteanimation(str(path), film, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    print(
        f"{path}: {path.stat().st_size / 1e6:.2f} MB, {len(wrist)} frames of "
        f"{film.durations[0]} ms; predicted {np.mean(predicted):.0%}; SSIM to the camera's frame, "
        f"mean: as received {scores[:, 0].mean():.3f}, as drawn {scores[:, 1].mean():.3f}"
    )


def columns(moment: Moment, received: float, drawn: float) -> Image:
    """Received, drawn and true beside each other, with their similarity to the last."""
    word = moment.shown.correction or f"as received: {moment.shown.as_received}"
    told = (
        (moment.received, f"received, {moment.age_ms:.0f} ms old", f"SSIM {received:.2f}"),
        (moment.shown.image, str(word), f"SSIM {drawn:.2f}"),
        (moment.true, "the camera now", ""),
    )
    width, height = SIZE
    picture = np.full((height + HEAD, len(told) * (width + GAP) - GAP, 3), BACKGROUND, np.uint8)
    for place, (image, name, score) in enumerate(told):
        left = place * (width + GAP)
        small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
        picture[HEAD:, left : left + width] = small
        _write(picture, name, left + 4)
        _write(picture, score, left + width - 92)
    return picture


def _write(picture: Image, text: str, x: int) -> None:
    cv2.putText(picture, text, (x, HEAD - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)


def outline(views: Mapping[str, Moment], path: Path) -> None:
    """Parts of the fixed views beside each other."""
    parts = [around_drawn(views[view].shown.image, views[view].received) for view in FIXED]
    cv2.imwrite(str(path), np.hstack(parts), [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f"{path}: " + ", ".join(f"{view} {views[view].age_ms:.0f} ms old" for view in FIXED))


def around_drawn(shown: Image, received: Image) -> Image:
    """The part of a picture in whose middle is what was drawn, a pixel for each received."""
    drawn = (shown != received).any(axis=2)
    rows, columns_ = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    left, top = (
        int(np.clip((ends[0] + ends[-1] - part) // 2, 0, whole - part))
        for ends, part, whole in zip((columns_, rows), PART, drawn.shape[::-1], strict=True)
    )
    return shown[top : top + PART[1], left : left + PART[0]]


def main() -> None:
    parser = ArgumentParser(prog="benchmarks.predicted", description=__doc__)
    parser.add_argument("what", choices=("animation", "outline"))
    parser.add_argument("--seed", type=int, default=0, help="of the scene (default 0)")
    parser.add_argument("--to", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    trial = watched(options.seed)
    if options.what == "animation":
        animation(trial.moments, options.to or DOCS / "predicted.webp")
    else:
        outline(trial.furthest, options.to or DOCS / "outline.jpg")


if __name__ == "__main__":
    main()

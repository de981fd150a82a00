"""The real window and headset with the predictive display and without, at one instant.

`python -m benchmarks.predicted_faces window`: docs/predicted-window.jpg, the window's views with
`view.predict` off and all. `python -m benchmarks.predicted_faces headset`:
docs/predicted-headset.jpg, the overlay in front. Frames, places of the arm and the instant are
those of `benchmarks.predicted outline`: the trial's clock stands still while the face draws.
"""

from __future__ import annotations

import threading
import time
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import msgspec
import numpy as np
import pytest

from benchmarks.predicted import BACKGROUND, DOCS, FIXED, GAP, HEAD, INK, WRIST, Watched, watched
from tams_app.config import HeadsetConfig
from tams_app.faces.client import WINDOW, Face, FaceClient
from tams_app.faces.messages import Facts
from tams_app.prediction.present import MountTrail
from tams_app.records import Image, MountPrediction
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.predicting import predicted_cameras
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.headset.steamvr import FAKED, steamvr
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.feeding import feeding
from tests.faces.window.photographs import place_of
from tests.faces.window.xvfb import virtual_screen, wait_for

SETTLING_S = 6.0
WIDTH_PX, FRAME_PX = 640, 5  # of a window's views together; around each of them
EVERY_S = 0.01


@dataclass(frozen=True, slots=True)
class Instant:
    """Of a trial: what was received of each view, how old that is, where the arm was and is."""

    trial: Watched
    frames: dict[str, Image]
    ages_ns: dict[str, int]
    belief: MountPrediction

    @staticmethod
    def of(trial: Watched) -> Instant:
        """When what was received differs most from what is there."""
        views, trail = trial.furthest, MountTrail()
        wrist = views[WRIST]
        ages_ns = {view: round(one.age_ms * NS_PER_MS) for view, one in views.items()}
        for prediction in trial.predictions:
            if prediction.now_ns <= wrist.t_ns:
                newest = prediction
                trail.add(prediction)
        then = trail.then(wrist.t_ns - ages_ns[WRIST])
        assert then is not None
        belief = replace(newest, then=then.mount, then_joints=then.joints)
        return Instant(trial, {view: one.received for view, one in views.items()}, ages_ns, belief)

    @property
    def facts(self) -> Facts:
        """What a session tells, with these ages."""
        states = {
            view: msgspec.structs.replace(state, age_ms=self.ages_ns[view] / NS_PER_MS)
            for view, state in FACTS.state.views.items()
        }
        return changed(FACTS, views=states, primary_view=WRIST)


@contextmanager
def shown(instant: Instant, face: Face, folder: Path, predict: bool) -> Iterator[None]:
    """A face that shows it, as long as the context lasts."""
    config = instant.trial.config
    video, clock, stop = config.video, MonotonicClock(), threading.Event()
    block = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
    mount = MountMemory(predicted_cameras(config))
    client = FaceClient(clock, face)
    client.launch(folder, headset=HeadsetConfig().model_dump())
    client.open(config, block, blind=False, mount=mount if predict else None)

    def feed() -> None:
        number = 0
        while not stop.wait(EVERY_S):
            now_ns, number = clock.now_ns(), number + 1
            mount.put(replace(instant.belief, then_ns=now_ns, now_ns=now_ns))
            for view, frame in instant.frames.items():
                block.put(view, number, now_ns, frame, now_ns - instant.ages_ns[view])

    threads = [
        threading.Thread(target=client.body(lambda _event: None), args=(stop,)),
        threading.Thread(target=feed),
    ]
    for thread in threads:
        thread.start()
    try:
        with feeding(client) as feeder:
            feeder.show(instant.facts)
            time.sleep(SETTLING_S)
            yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()
        client.close()
        mount.close()
        block.close()


def window(instant: Instant, predict: bool) -> Image:
    """The window's views, the large one above the small ones, without what is beside them."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        with virtual_screen(folder, patch) as screen, shown(instant, WINDOW, folder, predict):
            photograph = screen.photograph()
    large, *small = (_framed(photograph, view) for view in (WRIST, *FIXED))
    height = min(one.shape[0] for one in small)
    beside = np.hstack([one[:height] for one in small])
    return np.vstack([_wide(large), _wide(np.asarray(beside, np.uint8))])


def headset(instant: Instant, predict: bool) -> Image:
    """The overlay in front."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        with (
            virtual_screen(folder, patch),
            steamvr(folder, patch) as found,
            shown(instant, FAKED, folder, predict),
        ):
            assert wait_for(lambda: bool(found.seen("tams.view 0").any()))
            time.sleep(SETTLING_S)
            return np.asarray(found.seen("tams.view 0"), np.uint8)


def _framed(photograph: Image, view: str) -> Image:
    """The part of the window that a view has, with its frame."""
    place = place_of(photograph, view)
    assert place is not None
    rows, columns = (slice(one.start - FRAME_PX, one.stop + FRAME_PX) for one in place)
    return photograph[rows, columns]


def _wide(image: Image) -> Image:
    size = WIDTH_PX, round(WIDTH_PX * image.shape[0] / image.shape[1])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def named(image: Image, name: str) -> Image:
    """With a line above it."""
    head = np.full((HEAD, image.shape[1], 3), BACKGROUND, np.uint8)
    cv2.putText(head, name, (6, HEAD - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA)
    return np.vstack((head, image))


def main() -> None:
    parser = ArgumentParser(prog="benchmarks.predicted_faces", description=__doc__)
    parser.add_argument("what", choices=("window", "headset"))
    parser.add_argument("--seed", type=int, default=0, help="of the scene (default 0)")
    parser.add_argument("--to", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    instant = Instant.of(watched(options.seed))
    draw: Callable[[Instant, bool], Image] = window if options.what == "window" else headset
    pair = [
        named(draw(instant, predict), f"view.predict: {'all' if predict else 'off'}")
        for predict in (False, True)
    ]
    gap = np.full((pair[0].shape[0], GAP, 3), BACKGROUND, np.uint8)
    together = np.hstack([pair[0], gap, pair[1]])
    path = options.to or DOCS / f"predicted-{options.what}.jpg"
    cv2.imwrite(str(path), together, [cv2.IMWRITE_JPEG_QUALITY, 85])
    ages = ", ".join(f"{view} {ns / NS_PER_MS:.0f} ms" for view, ns in instant.ages_ns.items())
    print(f"{path}: {together.shape[1]} by {together.shape[0]}; received are frames of {ages} ago")


if __name__ == "__main__":
    main()

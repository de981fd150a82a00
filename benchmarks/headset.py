"""The views in the headset, without a graphics processor and without a headset: cost and picture.

`python -m benchmarks.headset cost`: processor time of the headset's process with three views of
640x480 at 30 frames a second and facts 10 times a second. OpenGL works in software, on a virtual
screen; OpenVR is a faked function table, so what SteamVR does with the texture is not in it.
`python -m benchmarks.headset picture`: docs/headset.jpg, the overlays as they are seen.
"""

from __future__ import annotations

import threading
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import msgspec
import numpy as np
import psutil
import pytest

from benchmarks.window import DOCS, SETTLING_S, picture_of, play, processor_s
from tams_app.config import CONFIG_DIRECTORY, HeadsetConfig, load_config
from tams_app.faces.client import FaceClient
from tams_app.faces.headset.layout import OTHERS_SHARE
from tams_app.faces.messages import Beat, Event, Notice
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.teleop.advice import what_to_do
from tams_app.teleop.hands import HANDS
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.headset.faked_process import BLIND
from tests.faces.headset.steamvr import FAKED, SteamVr, steamvr
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.feeding import feeding
from tests.faces.window.xvfb import virtual_screen, wait_for


@dataclass
class Measured:
    """A headset's process, what feeds it, and what it told."""

    client: FaceClient
    block: FrameBlock
    views: tuple[str, ...]
    steamvr: SteamVr
    events: list[Event] = field(default_factory=list)

    @property
    def drawings(self) -> int:
        return max((beat.drawings for beat in self.events if isinstance(beat, Beat)), default=0)

    def play(self, seconds: float) -> int:
        """How many frames of each view were published."""
        return play(self.client, self.block, self.views, seconds)


@contextmanager
def headset(patch: pytest.MonkeyPatch) -> Iterator[Measured]:
    """A headset's process that shows the default configuration's views."""
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    video = config.video
    with TemporaryDirectory() as name:
        folder = Path(name)
        with virtual_screen(folder, patch), steamvr(folder, patch) as found:
            block = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
            client, stop = FaceClient(MonotonicClock(), FAKED), threading.Event()
            measured = Measured(client, block, video.views, found)
            client.launch(folder, headset=HeadsetConfig().model_dump())
            client.open(config, block, blind=False)
            body = client.body(measured.events.append)
            hearing = threading.Thread(target=body, args=(stop,))
            hearing.start()
            try:
                yield measured
            finally:
                stop.set()
                hearing.join()
                client.close()
                block.close()


def cost(seconds: float) -> None:
    """Print what it takes, after it has settled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(BLIND, "1")
        with headset(patch) as measured:
            measured.play(SETTLING_S)
            process = psutil.Process(measured.client.pid)
            began_s, before_s, drawn = time.monotonic(), processor_s(process), measured.drawings
            frames = measured.play(seconds)
            passed_s, taken_s = time.monotonic() - began_s, processor_s(process) - before_s
            drawings = measured.drawings - drawn
    print(
        f"{drawings / passed_s:.1f} drawings a second of {frames / passed_s:.1f} frames of each "
        f"view, {100 * taken_s / passed_s:.1f} % of a core"
    )


def picture(path: Path) -> None:
    """All overlays as they are seen: the primary view in front, whose video is stale."""
    old = dict(FACTS.state.views)
    old["eih"] = msgspec.structs.replace(old["eih"], age_ms=1240.0)
    facts = changed(
        FACTS,
        views=old,
        arming="holding",
        reason="stale video",
        advice=what_to_do("stale video", "stale video", HANDS["openvr"]),
        notices=(Notice(12.4, "stopped: stale video"),),
    )
    with (
        pytest.MonkeyPatch.context() as patch,
        headset(patch) as measured,
        feeding(measured.client) as feeder,
    ):
        for view in measured.views:
            measured.block.put(view, 1, 1, picture_of(view))
        feeder.show(facts)
        keys = [f"tams.view {number}" for number in range(len(measured.views))]

        def seen() -> list[Image]:
            return [measured.steamvr.seen(key) for key in (*keys, "tams.panel")]

        assert wait_for(lambda: all(one.any() for one in seen()))
        time.sleep(2.0)  # for what came last
        front, right, left, panel = seen()
    front = np.vstack([front, np.zeros_like(front[:16]), _wide(panel, front.shape[1])])
    sides = [_wide(one, round(OTHERS_SHARE * front.shape[1])) for one in (left, right)]
    high = [np.zeros((front.shape[0], one.shape[1] + 32, 3), np.uint8) for one in sides]
    for blank, one in zip(high, sides, strict=True):
        blank[100 : 100 + one.shape[0], 16:-16] = one
    cv2.imwrite(str(path), np.hstack([high[0], front, high[1]]), [cv2.IMWRITE_JPEG_QUALITY, 85])


def _wide(image: Image, width: int) -> Image:
    height = round(width * image.shape[0] / image.shape[1])
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("cost", "picture"))
    parser.add_argument("--seconds", type=float, default=20.0, help="of the measurement")
    parser.add_argument("--to", type=Path, default=DOCS / "headset.jpg")
    arguments = parser.parse_args()
    if arguments.what == "picture":
        picture(arguments.to)
    else:
        cost(arguments.seconds)


if __name__ == "__main__":
    main()

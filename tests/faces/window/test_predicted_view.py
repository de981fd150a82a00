"""The real window with a camera on the arm: its frame is drawn as it would look now."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.client import WINDOW, FaceClient
from tams_app.records import Image, Pose
from tams_app.runtime.clock import MonotonicClock
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.feeding import feeding
from tests.faces.window.photographs import SAME, difference
from tests.faces.window.xvfb import Screen, virtual_screen, wait_for
from tests.prediction.wrist import above, camera_of, lens_of, picture, placed

pytestmark = pytest.mark.waiting

LENS = lens_of(640, 480)
LATE_NS = 120 * NS_PER_MS
FAR_M = 0.02  # at which little of the frame is outside
GREY = np.full((480, 640, 3), 90, np.uint8)


class Session:
    """An arm that stands at one place, is believed to be at another, and a frame of the first."""

    def __init__(self, screen: Screen, block: FrameBlock, mount: MountMemory) -> None:
        self.screen, self._block, self._mount = screen, block, mount
        self._clock = MonotonicClock()
        self._index = 0
        self.shows_frames = True
        self.now = above(0.0, 0.0, 0.2)

    def run(self, stop: threading.Event) -> None:
        """Frames and beliefs, as they come while a session runs."""
        there = above(0.0, 0.0, 0.2)
        frame = picture(LENS, there)
        while not stop.wait(0.01):
            now_ns = self._clock.now_ns()
            self._mount.put(placed(now_ns, there, self.now, late_ns=20 * NS_PER_MS))
            if self.shows_frames:
                self._index += 1
                self._block.put("eih", self._index, now_ns, frame, now_ns - LATE_NS)
                for view in ("gt", "gs"):
                    self._block.put(view, self._index, now_ns, GREY, now_ns - LATE_NS)

    def sees(self, flange: Pose) -> bool:
        """Whether the middle of the wrist view looks as from there."""
        return self._difference(picture(LENS, flange)) < SAME

    def _difference(self, image: Image) -> float:
        return difference(self.screen.photograph(), "eih", image)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder: Path = tmp_path_factory.mktemp("predicted")
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    video = config.video
    with pytest.MonkeyPatch.context() as patch, virtual_screen(folder, patch) as screen:
        block = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        mount = MountMemory({"eih": camera_of(640, 480)})
        client = FaceClient(MonotonicClock(), WINDOW)
        client.launch(folder)
        client.open(config, block, blind=False, mount=mount)
        stop, events = threading.Event(), []
        shown = Session(screen, block, mount)
        threads = [
            threading.Thread(target=client.body(events.append), args=(stop,)),
            threading.Thread(target=shown.run, args=(stop,)),
        ]
        with feeding(client) as feeder:
            feeder.show(changed(FACTS, t_s=time.monotonic()))
            for thread in threads:
                thread.start()
            screen.focus("TAMS")
            assert wait_for(lambda: client.keys is not None and client.keys.focused)
            try:
                yield shown
            finally:
                stop.set()
                for thread in threads:
                    thread.join()
        client.close()
        mount.close()
        block.close()


def test_the_frame_follows_where_the_arm_is_believed_to_be_without_a_new_one(
    session: Session,
) -> None:
    assert wait_for(lambda: session.sees(above(0.0, 0.0, 0.2)))
    session.now = above(FAR_M, 0.0, 0.2)
    assert wait_for(lambda: session.sees(session.now))
    assert not session.sees(above(0.0, 0.0, 0.2))
    session.now = above(0.0, 0.0, 0.2)
    assert wait_for(lambda: session.sees(session.now))


def test_f2_shows_the_frame_as_received_and_predicted_again(session: Session) -> None:
    session.now = above(FAR_M, 0.0, 0.2)
    assert wait_for(lambda: session.sees(session.now))
    session.screen.xdotool("key", "F2")
    assert wait_for(lambda: session.sees(above(0.0, 0.0, 0.2)))
    session.screen.xdotool("key", "F2")
    assert wait_for(lambda: session.sees(session.now))


def test_a_frame_that_has_grown_old_is_shown_as_received(session: Session) -> None:
    session.now = above(FAR_M, 0.0, 0.2)
    assert wait_for(lambda: session.sees(session.now))
    session.shows_frames = False
    assert wait_for(lambda: session.sees(above(0.0, 0.0, 0.2)))
    session.shows_frames = True
    assert wait_for(lambda: session.sees(session.now))

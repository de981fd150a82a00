"""The real headset's process with a camera on the arm: what SteamVR gets of a corrected view."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tams_app import palette
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.figures import is_old, view_title
from tams_app.faces.headset.layout import BORDER_PX, HEADER_PX, Atlas
from tams_app.faces.headset.painting import ViewCell
from tams_app.prediction.plane_warp import WristWarp
from tams_app.records import Image, Pose
from tams_app.runtime.clock import MonotonicClock
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_MS
from tests.faces.headset.conftest import WornHeadset, worn_headset
from tests.faces.window.facts import FACTS, OPENING, changed
from tests.faces.window.xvfb import wait_for
from tests.prediction.wrist import above, camera_of, lens_of, picture, placed

pytestmark = pytest.mark.waiting

LENS = lens_of(640, 480)
FRONT = "tams.view 0"
LATE_NS = 120 * NS_PER_MS
THERE, NOW = above(0.0, 0.0, 0.2), above(0.02, 0.0, 0.2)
RECEIVED = picture(LENS, THERE)
GREY = np.full((480, 640, 3), 90, np.uint8)
VIEW = FACTS.state.primary_view


@dataclass
class Session:
    """An arm that was at one place and is believed to be at another, and a frame of the first."""

    headset: WornHeadset
    mount: MountMemory
    now: Pose = NOW
    camera_fits: bool = True

    def run(self, stop: threading.Event) -> None:
        clock, index = MonotonicClock(), 0
        while not stop.wait(0.02):
            now_ns, index = clock.now_ns(), index + 1
            fits = self.camera_fits
            belief = placed(now_ns, THERE, self.now, late_ns=20 * NS_PER_MS, camera_fits=fits)
            self.mount.put(belief)
            for view in FACTS.state.views:
                frame = RECEIVED if view == VIEW else GREY
                self.headset.block.put(view, index, now_ns, frame, now_ns - LATE_NS)

    def tell(self, age_ms: float) -> None:
        """The age of what was received of the view."""
        views = dict(FACTS.state.views)
        views[VIEW] = msgspec.structs.replace(views[VIEW], age_ms=age_ms)
        self.headset.show(changed(FACTS, views=views))

    def has(self, frame: Image, words: str, age_ms: float) -> bool:
        """Whether the overlay in front has exactly this frame, and says this age and these words.

        Around it are the stripes of an old frame if that is its age.
        """
        seen = self.headset.steamvr.seen(FRONT)
        if seen.size == 0:
            return False
        inner = seen[HEADER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
        expected = expected_cell(words, age_ms)
        return np.array_equal(inner, frame) and all(
            np.array_equal(seen[part], expected[part])
            for part in (slice(HEADER_PX), slice(-BORDER_PX, None))
        )

    def comes_to_have(self, frame: Image, words: str, age_ms: float) -> bool:
        """Whether it has so at some moment: on a busy machine beliefs are missing now and then."""
        met = False

        def look() -> bool:
            nonlocal met
            met = met or self.has(frame, words, age_ms)
            return met

        return wait_for(look)


def expected_cell(words: str, age_ms: float) -> Image:
    """A cell of the primary view with its title, BGR."""
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    atlas = Atlas(config.video.views, config.video.width, config.video.height)
    cell = ViewCell(atlas, palette.view_colour(config.video.views.index(VIEW)))
    view = msgspec.structs.replace(FACTS.state.views[VIEW], age_ms=age_ms)
    state = changed(FACTS, views={VIEW: view}).state
    cell.set_title(view_title(VIEW, state, OPENING) + words, is_old(view, OPENING.old_ms))
    return cell.pixels[..., 2::-1]


def predicted(now: Pose) -> Image:
    warped = WristWarp(LENS, ()).to_now(RECEIVED, THERE, now)
    assert warped is not None
    return warped.image


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder: Path = tmp_path_factory.mktemp("predicted")
    mount = MountMemory({VIEW: camera_of(640, 480)})
    with worn_headset(folder, mount) as headset:
        session, stop = Session(headset, mount), threading.Event()
        feeding = threading.Thread(target=session.run, args=(stop,))
        feeding.start()
        try:
            yield session
        finally:
            stop.set()
            feeding.join()
    mount.close()


def test_the_overlay_has_the_frame_as_it_would_look_now_and_says_so(session: Session) -> None:
    session.tell(120.0)
    assert session.comes_to_have(predicted(NOW), " · predicted", 120.0)
    session.now = above(-0.01, 0.01, 0.2)
    assert session.comes_to_have(predicted(session.now), " · predicted", 120.0)
    session.now = NOW


def test_a_predicted_frame_is_as_old_as_what_was_received(session: Session) -> None:
    session.tell(1240.0)
    assert session.comes_to_have(predicted(NOW), " · predicted", 1240.0)
    assert not session.has(predicted(NOW), " · predicted", 120.0)


def test_the_overlay_has_the_frame_as_received_where_its_calibration_is_off(
    session: Session,
) -> None:
    session.tell(120.0)
    session.camera_fits = False
    words = " · as received: calibration off"
    assert session.comes_to_have(RECEIVED, words, 120.0)
    session.camera_fits = True
    assert session.comes_to_have(predicted(NOW), " · predicted", 120.0)

"""Which picture of a view is drawn, and what its title says of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tams_app.faces.views import Corrected
from tams_app.prediction.present import PredictedCamera
from tams_app.records import Lens, Pose, Solid, SolidKind
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.shared_ring import open_block
from tams_app.station.mount_memory import MountMemory, PresentViews
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, FrameReader, RingLayout
from tests.prediction.wrist import LOOKS_DOWN, STRAIGHT, above, camera_of, lens_of, picture, placed

pytestmark = pytest.mark.untimed

FIXED = Lens.ideal("base", Pose(np.array([0.0, 0.0, 0.4]), LOOKS_DOWN), 60.0, 64, 48)
BOX = Solid(SolidKind.BOX, Pose(np.zeros(3), STRAIGHT), (0.1, 0.1, 0.02), (0.0,) * 3)
CAMERAS = {
    "eih": camera_of(64, 48),
    "gs": PredictedCamera(FIXED, (BOX,), on_arm=False),
}
THEN, NOW = above(0.0, 0.0, 0.20), above(0.02, 0.0, 0.20)
FRAME = picture(lens_of(64, 48), THEN)
AGE_NS = 120 * NS_PER_MS


class Bench:
    """Two views, one of them of a camera on the arm."""

    def __init__(self) -> None:
        layout = RingLayout(SHOWN, ("eih", "gt", "gs"), 64, 48)
        self.block = FrameBlock(layout)
        self.block.create()
        self.clock = VirtualClock(NS_PER_S)
        self.mount = MountMemory(CAMERAS)
        memory = open_block(self.block.name)
        readers = {view: FrameReader(memory, layout, view) for view in layout.views}
        present = PresentViews(CAMERAS, open_block(self.mount.name))
        self.corrected = Corrected(present, readers, self.clock)
        self.plain = Corrected(None, readers, self.clock)

    def put(self, view: str) -> None:
        now_ns = self.clock.now_ns()
        self.block.put(view, 1, now_ns, FRAME, now_ns - AGE_NS)

    def know(self, trusted: bool = True) -> None:
        """Where the mount was and is, for the last half second."""
        for late_ms in range(500, -1, -10):
            now_ns = self.clock.now_ns() - late_ms * NS_PER_MS
            self.mount.put(placed(now_ns, THEN, NOW, late_ns=20 * NS_PER_MS, trusted=trusted))

    def rest(self) -> None:
        """The mount is where it was all the time, from now on."""
        now_ns = self.clock.now_ns() + NS_PER_MS
        self.mount.put(placed(now_ns, THEN, THEN))
        self.clock.sleep_until_ns(now_ns)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.mount.close()
    bench.block.close()


def test_a_fixed_view_gets_an_outline_until_it_has_caught_up_and_says_so(bench: Bench) -> None:
    bench.put("gs")
    bench.know()
    image = bench.corrected.newest("gs")
    assert image is not None
    assert (image != FRAME).any()
    assert bench.corrected.words("gs") == " · outline: now"
    assert bench.corrected.moves("gs")
    bench.rest()
    assert (bench.corrected.newest("gs") == FRAME).all()
    assert bench.corrected.words("gs") == ""


def test_what_cannot_be_corrected_is_drawn_as_received_and_says_why(bench: Bench) -> None:
    bench.put("eih")
    assert (bench.corrected.newest("eih") == FRAME).all()
    assert bench.corrected.words("eih") == " · as received: arm not known"
    assert not bench.corrected.moves("eih")
    bench.know(trusted=False)
    assert (bench.corrected.newest("eih") == FRAME).all()
    assert bench.corrected.words("eih") == " · as received: prediction off"


def test_the_wrist_view_is_drawn_as_it_would_look_now_and_by_a_key_as_received(
    bench: Bench,
) -> None:
    bench.put("eih")
    bench.know()
    assert (bench.corrected.newest("eih") != FRAME).any()
    assert bench.corrected.moves("eih")
    bench.corrected.toggle()
    assert (bench.corrected.newest("eih") == FRAME).all()
    assert bench.corrected.words("eih") == " · as received"
    assert not bench.corrected.moves("eih")
    bench.corrected.toggle()
    assert (bench.corrected.newest("eih") != FRAME).any()
    assert bench.corrected.words("eih") == " · predicted"


def test_views_of_cameras_that_stand_still_are_drawn_as_received_without_a_word(
    bench: Bench,
) -> None:
    for view in ("eih", "gt"):
        bench.put(view)
    bench.know()
    assert (bench.corrected.newest("gt") == FRAME).all()
    assert bench.corrected.words("gt") == ""
    assert not bench.corrected.moves("gt")
    assert (bench.plain.newest("eih") == FRAME).all()
    assert bench.plain.words("eih") == ""


def test_nothing_is_drawn_or_said_before_the_first_frame(bench: Bench) -> None:
    assert bench.corrected.newest("eih") is None
    assert bench.corrected.words("eih") == ""

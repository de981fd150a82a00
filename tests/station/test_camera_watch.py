"""A camera that is not where it should be: one sentence, and all who draw know it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.prediction.present import AsReceived, Correction, PredictedCamera
from tams_app.records import Lens, Pose, ShownFrame, Solid, SolidKind
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.parts import Parts
from tams_app.runtime.shared_ring import open_block
from tams_app.station.mount_memory import CameraWatch, MountMemory, PresentViews, misfit
from tams_app.station.screen import Screen
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.prediction.test_camera_check import FINER, LENS, to_and_fro, turned
from tests.prediction.wrist import LOOKS_DOWN, STRAIGHT, picture, placed
from tests.session.exchange import Unkept

pytestmark = pytest.mark.untimed

WRONG = turned(0.0, 0.0, 90.0)
FRAME_NS, LATE_NS = 100 * NS_PER_MS, 150 * NS_PER_MS
FIXED = Lens.ideal("base", Pose(np.array([0.0, 0.0, 0.4]), LOOKS_DOWN), 60.0, 160, 120)
BOX = Solid(SolidKind.BOX, Pose(np.zeros(3), STRAIGHT), (0.1, 0.1, 0.02), (0.0,) * 3)


class Bench:
    """Frames of a camera at `LENS`, which the session takes to be at `believed`."""

    def __init__(self, believed: Lens) -> None:
        cameras = {
            "eih": PredictedCamera(believed, ()),
            "gs": PredictedCamera(FIXED, (BOX,), on_arm=False),
        }
        self.is_wrong = believed is not LENS
        self.mount = MountMemory(cameras)
        self.notes: list[tuple[str, str]] = []
        self.watch = CameraWatch(self.mount, lambda *note: self.notes.append(note))
        self.present = PresentViews(cameras, open_block(self.mount.name))
        self.mount.hide()
        self.now_ns = 0

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * NS_PER_S / FRAME_NS)):
            self.now_ns += FRAME_NS
            capture_ns = self.now_ns - LATE_NS
            then, now = (to_and_fro(t_ns / NS_PER_S) for t_ns in (capture_ns, self.now_ns))
            fits = self.mount.camera_fits
            self.mount.put(placed(self.now_ns, then, now, late_ns=LATE_NS, camera_fits=fits))
            image = picture(LENS, then, FINER)
            for view in ("eih", "gs"):
                self.watch.shown(ShownFrame(view, 0, self.now_ns, image, capture_ns, True))

    def shown(self, view: str) -> AsReceived | Correction | None:
        capture_ns = self.now_ns - LATE_NS
        frame = picture(LENS, to_and_fro(capture_ns / NS_PER_S), FINER)
        shown = self.present.show(view, frame, capture_ns, self.now_ns)
        return shown.as_received or shown.correction


@pytest.fixture(params=[LENS, WRONG], ids=["right", "wrong"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = Bench(request.param)
    yield bench
    bench.mount.close()


def test_only_a_wrong_camera_s_view_is_shown_as_received_and_a_sentence_says_so_once(
    bench: Bench,
) -> None:
    bench.run(1.0)
    assert bench.shown("eih") is Correction.PREDICTED
    bench.run(25.0)
    assert bench.notes == ([("warning", misfit("eih"))] if bench.is_wrong else [])
    assert bench.shown("eih") is (AsReceived.MISFIT if bench.is_wrong else Correction.PREDICTED)
    assert bench.shown("gs") is Correction.OUTLINE


def test_a_camera_that_stands_still_is_not_one_on_the_arm(bench: Bench) -> None:
    with pytest.raises(TypeError, match="gs is not of a camera on the arm"):
        bench.present.on_arm("gs")


def test_the_station_has_the_frames_checked_that_it_shows(tmp_path: Path) -> None:
    config = load_config(None, {"video.width": LENS.width, "video.height": LENS.height})
    told: list[str] = []
    log = Unkept(VirtualClock(), told.append)
    parts, cameras = Parts(tmp_path, pytest.fail, 0), {"eih": PredictedCamera(WRONG, ())}
    with parts.stack:
        screen = Screen(config.video, parts, log, cameras)
        assert screen.mount is not None
        for step in range(1, 150):
            capture_ns = step * FRAME_NS
            then = to_and_fro(capture_ns / NS_PER_S)
            screen.mount.put(placed(capture_ns, then, then))
            image = picture(LENS, then, FINER)
            screen.show(ShownFrame("eih", step, capture_ns, image, capture_ns, True))
        assert told == [misfit("eih")]
        assert not screen.mount.camera_fits

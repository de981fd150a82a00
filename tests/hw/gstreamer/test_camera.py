"""Cameras whose frames stay away: real GStreamer chains that end, fail, stall or repeat."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from hw.gstreamer.camera import GstCamera
from hw.gstreamer.capture import GstCapture
from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S

SMALL = VideoConfig(width=160, height=120)
CAPS = "video/x-raw,format=I420,width=160,height=120,framerate=30/1"
# by wall time: like a sensor, it never shows the same frame twice, also when opened again
MOVING = f"videotestsrc is-live=true pattern=ball animation-mode=wall-time ! {CAPS}"
STILL = f"videotestsrc is-live=true pattern=blue ! {CAPS}"
TIMEOUT_S = 10.0  # generous: the machine may be busy

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]


class PlayedSource:
    """Opens the given chains one after the other, the last one again and again."""

    label, endless = "played camera", True

    def __init__(self, *chains: str | Exception, noisy: bool = True) -> None:
        self._chains = list(chains)
        self.noisy = noisy
        self.opened: list[str] = []
        self.capture: GstCapture | None = None
        self.says: list[str] = []
        self.probe: tuple[str, Callable[[Any, Any], Any]] | None = None  # an element, what sees it

    def open(self) -> GstCapture:
        chain = self._chains.pop(0) if len(self._chains) > 1 else self._chains[0]
        self.opened.append(str(chain))
        if isinstance(chain, Exception):
            raise chain
        self.capture = GstCapture(chain, SMALL)
        if self.probe is not None:
            name, see = self.probe
            pad = self.capture._pipeline[name].get_static_pad("src")
            pad.add_probe(gst.load().Gst.PadProbeType.BUFFER, see)
        return self.capture

    def complaints(self) -> list[str]:
        return self.says


Notes = list[tuple[str, str]]
Make = Callable[[PlayedSource], tuple[GstCamera, Notes]]


@pytest.fixture
def make() -> Iterator[Make]:
    cameras: list[GstCamera] = []

    def make(source: PlayedSource) -> tuple[GstCamera, Notes]:
        notes: Notes = []
        note = lambda level, text: notes.append((level, text))  # noqa: E731
        cameras.append(GstCamera("eih", source, SMALL, MonotonicClock(), note))
        return cameras[-1], notes

    yield make
    for camera in cameras:
        camera.close()


def next_of(camera: GstCamera) -> Frame:
    frame = camera.next_frame(TIMEOUT_S)
    assert frame is not None
    return frame


def until_trouble(camera: GstCamera, last: Frame | None = None) -> Frame:
    """The last frame before the camera is in trouble; `last` if there is none after it."""
    while not camera.trouble:
        last = camera.next_frame(0.05) or last
    assert last is not None
    return last


def assert_grid_goes_on(before: Frame, after: Frame) -> None:
    periods = (after.capture_ns - before.capture_ns) * SMALL.fps / NS_PER_S
    assert after.index > before.index
    assert after.index - before.index == pytest.approx(periods, abs=1.6)


@pytest.mark.parametrize(
    ("chain", "reason"),
    [
        (MOVING.replace("videotestsrc", "videotestsrc num-buffers=6"), "its frames ended"),
        (f"{MOVING} ! identity error-after=6", "identity"),
    ],
)
def test_a_camera_that_ends_or_fails_gives_its_reason_is_opened_again_and_its_grid_goes_on(
    make: Make, chain: str, reason: str
) -> None:
    camera, notes = make(PlayedSource(chain, MOVING))
    camera.start()
    before = until_trouble(camera)
    assert notes[0][1].startswith(f"camera eih (played camera) failed: {reason}")
    assert_grid_goes_on(before, next_of(camera))
    assert [level for level, _ in notes] == ["warning", "info"]
    assert notes[1][1].startswith("camera eih delivers again, after ")
    assert camera.trouble == ""


def test_a_camera_that_falls_silent_is_opened_again(make: Make) -> None:
    source = PlayedSource(f"{MOVING} ! valve name=valve", MOVING)
    camera, notes = make(source)
    camera.start()
    before = next_of(camera)
    source.capture._pipeline["valve"].set_property("drop", True)
    before = until_trouble(camera, before)
    assert "delivers no frames" in notes[0][1]
    after = next_of(camera)
    assert after.capture_ns - before.capture_ns > NS_PER_S // 2
    assert_grid_goes_on(before, after)
    assert after.index - before.index >= 15
    assert len(source.opened) == 2


def test_a_sensor_that_repeats_one_frame_is_not_shown_however_often_it_is_opened(
    make: Make,
) -> None:
    source = PlayedSource(STILL, STILL, MOVING)
    camera, notes = make(source)
    camera.start()
    while not camera.trouble:
        assert camera.next_frame(0.05) is None
    assert "repeats one frame to the last bit" in notes[0][1]
    after = next_of(camera)
    assert len(source.opened) == 3
    assert after.index > SMALL.fps  # counted on over a second without a frame
    assert [level for level, _ in notes] == ["warning", "info"]


def test_a_pattern_may_repeat_one_frame(make: Make) -> None:
    camera, notes = make(PlayedSource(STILL, noisy=False))
    camera.start()
    frames = [next_of(camera) for _ in range(45)]
    assert frames[-1].capture_ns - frames[0].capture_ns > NS_PER_S
    assert notes == []


def test_a_camera_that_is_away_is_tried_about_once_a_second_and_told_once(make: Make) -> None:
    ends = MOVING.replace("videotestsrc", "videotestsrc num-buffers=40")
    pulled_out = OSError(19, "No such device")
    source = PlayedSource(ends, DeviceError("no camera at all"), pulled_out, MOVING)
    camera, notes = make(source)
    camera.start()
    until_trouble(camera)
    next_of(camera)
    assert [text.split(" (played camera) ")[-1] for _, text in notes[:2]] == [
        "failed: its frames ended",
        "is away: no camera at all",
    ]
    assert [level for level, _ in notes] == ["warning", "warning", "info"]
    assert len(source.opened) == 4


def test_what_the_device_does_not_do_is_told_once(make: Make) -> None:
    ends = MOVING.replace("videotestsrc", "videotestsrc num-buffers=3")
    source = PlayedSource(ends, MOVING)
    source.says = ["keeps gain at 7 although 9 was set"]
    camera, notes = make(source)
    camera.start()
    until_trouble(camera)
    next_of(camera)
    told = [text for _, text in notes if "keeps gain" in text]
    assert told == ["camera eih (played camera) keeps gain at 7 although 9 was set"]

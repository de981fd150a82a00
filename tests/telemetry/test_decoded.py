"""The video in a log can be decoded: from each keyframe on, and what was shown at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tams_app import gst
from tams_app.recording import LOG_NAME, read_video
from tams_app.records import EncodedFrame, Image, ShownFrame
from tams_app.video.core.colour import bgr_of
from tests.foxglove_messages import messages
from tests.session.virtual.runs import WALL_NS, run, short

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(600)]

VIEWS = ("eih", "gt", "gs")
Shown = dict[tuple[str, int], ShownFrame]


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Shown]:
    """The log of two seconds without loss and with a keyframe each, and every frame shown."""
    folder = tmp_path_factory.mktemp("trial")
    shown: Shown = {}

    def watch(frame: ShownFrame) -> None:
        shown[frame.view, frame.index] = frame

    changes = {"network": "none", "seconds": 2.0, "video.keyframe_interval": 8}
    run(short(**changes), folder, watch)
    return folder / LOG_NAME, shown


def decoded(frames: list[EncodedFrame], height: int, width: int) -> dict[int, Image]:
    """By libav (`avdec_h264`), by index; the frames from the first on."""
    Gst = gst.load().Gst
    pipeline = gst.parse_pipeline(
        "appsrc name=in format=time block=true max-buffers=8 "
        'caps="video/x-h264,stream-format=byte-stream,alignment=au" '
        "! h264parse ! avdec_h264 max-threads=1 ! video/x-raw,format=I420 "
        "! appsink name=out sync=false"
    )
    gst.set_playing(pipeline, "the decoder")
    source, sink = pipeline.get_by_name("in"), pipeline.get_by_name("out")
    for order, frame in enumerate(frames):
        source.emit("push-buffer", gst.raw_buffer(frame.data, order * Gst.MSECOND, Gst.MSECOND))
    source.emit("end-of-stream")
    images: dict[int, Image] = {}
    while (sample := sink.emit("try-pull-sample", 20 * Gst.SECOND)) is not None:
        buffer = sample.get_buffer()
        index = frames[round(buffer.pts / Gst.MSECOND)].index
        images[index] = bgr_of(gst.pixels_of(buffer), height, width)
    gst.shut_down(pipeline)
    return images


@pytest.mark.parametrize("view", VIEWS)
def test_from_each_keyframe_on_the_bitstream_gives_the_frames_that_were_shown(
    view: str, trial: tuple[Path, Shown]
) -> None:
    path, shown = trial
    frames = list(read_video(path, view))
    starts = [number for number, frame in enumerate(frames) if frame.keyframe]
    assert len(starts) >= 2
    for start in starts:
        images = decoded(frames[start:], 480, 640)
        assert list(images) == [frame.index for frame in frames[start:]]
        compared = [index for index in images if (view, index) in shown]
        assert len(compared) > 0
        for index in compared:
            assert np.array_equal(images[index], shown[view, index].image)


@pytest.mark.parametrize("view", VIEWS)
def test_the_pictures_are_the_frames_shown_at_their_time(
    view: str, trial: tuple[Path, Shown]
) -> None:
    path, shown = trial
    by_wall = {
        one.shown_ns + WALL_NS - 1_000_000_000: one.image
        for one in shown.values()
        if one.view == view
    }
    pictures: list[tuple[int, dict[str, Any]]] = [
        (wall_ns, content)
        for topic, wall_ns, content in messages(path)
        if topic == f"/shown/{view}"
    ]
    assert len(pictures) in (4, 5)
    for wall_ns, content in pictures:
        image = cv2.imdecode(np.frombuffer(content["data"], np.uint8), cv2.IMREAD_COLOR)
        assert cv2.PSNR(image, by_wall[wall_ns]) > 30

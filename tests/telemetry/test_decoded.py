"""The video in a log can be decoded: from each keyframe on, and what was shown at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tams_app.recording import LOG_NAME, read_video
from tams_app.records import EncodedFrame, Image, ShownFrame
from tams_app.video.core.codecs import bgr_of
from tams_app.video.live.codecs import decoded
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


def images_of(frames: list[EncodedFrame]) -> dict[int, Image]:
    """By index, the frames from the first on."""
    indices = {frame.capture_ns: frame.index for frame in frames}
    found = decoded(iter(frames))
    return {indices[capture_ns]: bgr_of(planes, 480, 640) for capture_ns, planes in found}


@pytest.mark.parametrize("view", VIEWS)
def test_from_each_keyframe_on_the_bitstream_gives_the_frames_that_were_shown(
    view: str, trial: tuple[Path, Shown]
) -> None:
    path, shown = trial
    frames = list(read_video(path, view))
    starts = [number for number, frame in enumerate(frames) if frame.keyframe]
    assert len(starts) >= 2
    for start in starts:
        images = images_of(frames[start:])
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

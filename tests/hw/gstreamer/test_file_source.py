"""Video files and test patterns as cameras, over real GStreamer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hw.gstreamer.camera import FrameSource, GstCamera
from hw.gstreamer.capture import FileSource, PatternSource
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tests.contract.camera_rigs import write_video
from tests.hw.v4l2.fake_cameras import jpegs

SMALL = VideoConfig(width=160, height=120)
TIMEOUT_S = 10.0  # generous: the machine may be busy

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]


def film(source: FrameSource, frames: int) -> tuple[list[Frame], list[tuple[str, str]]]:
    notes: list[tuple[str, str]] = []
    camera = GstCamera(
        "gt", source, SMALL, MonotonicClock(), lambda level, text: notes.append((level, text))
    )
    camera.start()
    found = [camera.next_frame(TIMEOUT_S) for _ in range(frames)]
    camera.close()
    return [frame for frame in found if frame is not None], notes


def test_a_file_is_played_again_and_again_and_that_is_no_trouble(tmp_path: Path) -> None:
    video = tmp_path / "it's a video with sound.mkv"
    write_video(video, frames=12)
    frames, notes = film(FileSource(str(video), SMALL), 40)
    assert len(frames) == 40
    assert notes == []
    assert frames[-1].index >= 39


def test_a_file_of_another_shape_gets_black_borders(tmp_path: Path) -> None:
    video = tmp_path / "square.mkv"
    write_video(video, frames=10, size="width=200,height=200")
    frames, _ = film(FileSource(str(video), SMALL), 3)
    image = frames[-1].image
    assert image.shape == (120, 160, 3)
    assert image[:, :18].max() <= 16
    assert image[:, -18:].max() <= 16
    assert image[:40, 24:-24].max() > 100


def test_a_slow_file_leaves_places_empty(tmp_path: Path) -> None:
    video = tmp_path / "slow.mkv"
    write_video(video, frames=40, fps=10)
    frames, _ = film(FileSource(str(video), SMALL), 6)
    assert frames[-1].index - frames[0].index >= 15


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"camera gt: there is no video file .*none\.mkv"):
        film(FileSource(str(tmp_path / "none.mkv"), SMALL), 1)


def test_a_file_that_is_no_video_is_a_device_error(tmp_path: Path) -> None:
    text = tmp_path / "text.mkv"
    text.write_text("this is no video\n" * 100)
    with pytest.raises(DeviceError, match=r"text\.mkv gives no frame: \w+: .*text file"):
        film(FileSource(str(text), SMALL), 1)


def test_a_file_without_times_says_what_to_do(tmp_path: Path) -> None:
    bare = tmp_path / "bare.mjpg"
    bare.write_bytes(b"".join(jpeg.rstrip(b"\0") for jpeg in jpegs(SMALL)))
    try:  # told by the start, or by the first look if that comes sooner
        _, ((level, said), *_) = film(FileSource(str(bare), SMALL), 1)
        assert level == "warning"
    except DeviceError as error:
        said = str(error)
    assert "its frames carry no times; put the video in a container like .mkv" in said


def test_a_pattern_moves() -> None:
    frames, notes = film(PatternSource(SMALL), 3)
    assert not np.array_equal(frames[0].image, frames[1].image)
    assert notes == []

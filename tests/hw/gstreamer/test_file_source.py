"""Video files and test patterns as cameras, over real GStreamer."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hw.gstreamer.camera import FrameSource, GstCamera
from hw.gstreamer.capture import FileSource, PatternSource
from tams_app import gst
from tams_app.cli import _main
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tests.contract.camera_rigs import write_video
from tests.export.sessions import moving_session
from tests.hw.gstreamer.damaged_videos import JPEG, jpeg, number_of, write
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


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"camera gt: there is no video file .*none\.mkv"):
        film(FileSource(str(tmp_path / "none.mkv"), SMALL), 1)


def test_a_file_that_is_no_video_is_a_device_error(tmp_path: Path) -> None:
    text = tmp_path / "text.mkv"
    text.write_text("this is no video\n" * 100)
    with pytest.raises(
        DeviceError, match=r"text\.mkv gives no frame: it is .* not a video.*text file"
    ):
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


CODED = {
    "h264.mp4": "x264enc key-int-max=10 ! mp4mux name=mux",
    "mpeg4.avi": "avenc_mpeg4 ! avimux name=mux",
    "h264.ts": "x264enc key-int-max=10 ! mpegtsmux name=mux",
    "vp9.webm": "vp9enc cpu-used=8 deadline=1 ! webmmux name=mux",
}


@pytest.mark.parametrize("name", CODED)
def test_what_the_installed_decoders_play_is_played(tmp_path: Path, name: str) -> None:
    write_video(tmp_path / name, chain=CODED[name])
    frames, notes = film(FileSource(str(tmp_path / name), SMALL), 20)
    assert len(frames) == 20
    assert len({frame.image.tobytes() for frame in frames}) > 1  # any two: it may begin again
    assert notes == []


def test_what_the_export_writes_is_played(tmp_path: Path) -> None:
    session = moving_session(tmp_path / "session")
    assert _main(["export", str(session), "--format", "lerobot"]) == 0
    (video,) = (session / "lerobot/videos/observation.images.gt").rglob("*.mp4")
    frames, notes = film(FileSource(str(video), SMALL), 20)
    assert (len(frames), notes) == (20, [])


def test_a_video_is_turned_as_its_file_says(tmp_path: Path) -> None:
    write_video(tmp_path / "upright.mp4", chain=CODED["h264.mp4"])
    data = (tmp_path / "upright.mp4").read_bytes()
    unit, quarter = (0x10000, 0, 0, 0, 0x10000), (0, 0x10000, 0, -0x10000, 0)
    parts = [struct.pack(">5i", *matrix) for matrix in (unit, quarter)]
    assert data.count(parts[0]) == 2  # the film's and the track's
    at = data.rindex(parts[0])
    turned = data[:at] + parts[1] + data[at + len(parts[1]) :]
    (tmp_path / "turned.mp4").write_bytes(turned)
    (frame, *_), _ = film(FileSource(str(tmp_path / "turned.mp4"), SMALL), 1)
    assert frame.image[:, :30].max() <= 16  # taller than wide now: borders at its sides
    assert frame.image[:, -30:].max() <= 16
    assert frame.image[4:-4, 40:-40].max(axis=2).min() < 60 < frame.image[:, 60:100].max()


def test_a_file_keeps_its_own_times_and_its_pauses_are_no_failure(tmp_path: Path) -> None:
    times_s = (0.0, 0.1, 1.3, 1.4, 2.6)
    write(tmp_path / "pauses.mkv", JPEG, [(jpeg(number), False) for number in range(5)], times_s)
    source = FileSource(str(tmp_path / "pauses.mkv"), SMALL)
    frames, notes = film(source, 5)
    assert [number_of(frame.image, 5) for frame in frames] == [1, 2, 3, 4, 0]  # one at the start
    apart_s = np.diff([frame.capture_ns for frame in frames]) / NS_PER_S
    assert apart_s[:3] == pytest.approx([1.2, 0.1, 1.2], abs=0.02)
    assert notes == []


def test_a_file_without_pictures_says_so(tmp_path: Path) -> None:
    sound = "fakesink audiotestsrc num-buffers=100 ! vorbisenc ! matroskamux"
    write_video(tmp_path / "sound.mkv", chain=sound)
    with pytest.raises(DeviceError, match="it has no video stream; choose another file"):
        film(FileSource(str(tmp_path / "sound.mkv"), SMALL), 1)


@pytest.mark.parametrize("sound", ["", "audiotestsrc num-buffers=90 ! avenc_aac ! mux."])
def test_a_missing_decoder_is_named_with_its_package(tmp_path: Path, sound: str) -> None:
    write_video(tmp_path / "h264.mp4", chain=CODED["h264.mp4"], sound=sound)
    with without("video/x-h264"), pytest.raises(DeviceError) as raised:
        film(FileSource(str(tmp_path / "h264.mp4"), SMALL), 1)
    assert "GStreamer cannot decode video/x-h264 (H.264" in str(raised.value)
    assert str(raised.value).endswith("; install gstreamer1.0-libav")


@contextmanager
def without(kind: str) -> Iterator[None]:
    """No decoder here plays streams of this kind."""
    Gst: Any = gst.load().Gst
    caps = Gst.Caps.from_string(kind)
    decoders = Gst.ElementFactory.list_get_elements(
        Gst.ELEMENT_FACTORY_TYPE_DECODER, Gst.Rank.MARGINAL
    )
    ranks = [(one, one.get_rank()) for one in decoders if one.can_sink_any_caps(caps)]
    for factory, _ in ranks:
        factory.set_rank(0)
    try:
        yield
    finally:
        for factory, rank in ranks:
            factory.set_rank(rank)


@pytest.mark.parametrize("share", [0.0, 0.5], ids=["empty", "cut off"])
def test_a_damaged_file_is_called_that(tmp_path: Path, share: float) -> None:
    write_video(tmp_path / "whole.mp4", chain=CODED["h264.mp4"])
    data = (tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "part.mp4").write_bytes(data[: int(share * len(data))])
    with pytest.raises(DeviceError, match=r"part\.mp4 gives no frame: it is damaged"):
        film(FileSource(str(tmp_path / "part.mp4"), SMALL), 1)


def test_a_pattern_moves() -> None:
    frames, notes = film(PatternSource(SMALL), 3)
    assert not np.array_equal(frames[0].image, frames[1].image)
    assert notes == []

"""Frames that arrive damaged, over real GStreamer chains: they are no frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hw.gstreamer.camera import GstCamera
from hw.gstreamer.capture import FileSource
from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tests.hw.gstreamer.damaged_videos import (
    cut,
    h264_units,
    hole,
    jpeg,
    mjpeg,
    not_a_picture,
    number_of,
    write,
)
from tests.hw.gstreamer.test_camera import PlayedSource

SMALL = VideoConfig(width=160, height=120)
TIMEOUT_S = 10.0  # generous: the machine may be busy
FRAMES = 30

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]


class Film:
    """What a camera gave until its frames ended or failed."""

    def __init__(self, source: PlayedSource | FileSource, frames: int) -> None:
        notes: list[str] = []
        camera = GstCamera(
            "gt", source, SMALL, MonotonicClock(), lambda _, text: notes.append(text)
        )
        camera.start()
        self.frames: list[Frame] = []
        while not camera.trouble and len(self.frames) < frames:
            frame = camera.next_frame(0.1)
            if frame is not None:
                self.frames.append(frame)
        camera.close()
        self.notes = notes
        self.damage = [text for text in notes if "damaged" in text]
        self.numbers = {number_of(frame.image, FRAMES) for frame in self.frames}
        self.damaged = sum(frame.damaged for frame in self.frames)


def played(path: Path) -> PlayedSource:
    """A camera with these frames, each when it is due; its end is a failure."""
    return PlayedSource(
        f"filesrc location={path} ! matroskademux ! image/jpeg ! jpegdec ! identity sync=true",
        DeviceError("over"),
    )


ODD = range(1, FRAMES, 2)


@pytest.mark.parametrize(
    ("damage", "cause"),
    [
        (cut, "JPEG pictures lack their end"),
        (hole, "JPEG pictures lack a part"),
        (not_a_picture, "JPEG pictures cannot be decoded"),
    ],
)
def test_damaged_jpegs_are_left_out_counted_and_reported_once(
    tmp_path: Path, damage: Callable[[bytes], bytes], cause: str
) -> None:
    mjpeg(tmp_path / "bad.mkv", FRAMES, damage, ODD)
    film = Film(played(tmp_path / "bad.mkv"), FRAMES)
    assert film.numbers <= set(range(0, FRAMES, 2))
    assert 10 <= film.damaged <= len(ODD)
    assert film.damage == [
        f"camera gt (played camera) gives damaged frames, which are left out: {cause}; "
        "check its cable, or give it a USB port and bus of its own"
    ]


def test_without_the_library_that_finds_holes_a_camera_runs_and_says_so_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hw.gstreamer.damage.turbojpeg", lambda: None)
    mjpeg(tmp_path / "bad.mkv", FRAMES, cut, ODD)
    film = Film(played(tmp_path / "bad.mkv"), FRAMES)
    assert film.numbers <= set(range(0, FRAMES, 2))
    unwatched = "camera gt (played camera) is not watched for JPEGs that lack a part"
    assert len([text for text in film.notes if text.startswith(unwatched)]) == 1


def test_where_all_frames_are_damaged_there_is_none_and_the_reason_is_told(tmp_path: Path) -> None:
    mjpeg(tmp_path / "bad.mkv", 8, cut, range(8))
    with pytest.raises(DeviceError, match="gives no frame: all are damaged: JPEG pictures lack"):
        Film(played(tmp_path / "bad.mkv"), 1)
    with pytest.raises(DeviceError, match=r"all are damaged: .* lack their end; choose another"):
        Film(FileSource(str(tmp_path / "bad.mkv"), SMALL), 1)


@pytest.mark.parametrize(
    ("place", "flag"), [("link", "CORRUPTED"), ("link", "DISCONT"), ("decoded", "CORRUPTED")]
)
def test_what_follows_a_frame_that_the_decoder_marks_is_left_out_up_to_the_next_keyframe(
    tmp_path: Path, place: str, flag: str
) -> None:
    """And what is marked before it, or follows a gap."""
    caps, units = h264_units(FRAMES, keyframe_every=10)
    write(tmp_path / "good.mkv", caps, units)
    Gst: Any = gst.load().Gst
    source = PlayedSource(
        f"filesrc location={tmp_path / 'good.mkv'} ! matroskademux ! identity sync=true name=link "
        "! h264parse ! avdec_h264 max-threads=1 ! identity name=decoded",
        DeviceError("over"),
    )
    passed: list[int] = []

    def mark(_pad: Any, probe: Any) -> Any:
        if len(passed) == 13:
            probe.get_buffer().set_flags(getattr(Gst.BufferFlags, flag))
        passed.append(len(passed))
        return Gst.PadProbeReturn.OK

    source.probe = (place, mark)
    film = Film(source, FRAMES)
    assert film.numbers <= {*range(13), *range(20, FRAMES)}
    assert film.numbers & set(range(20, FRAMES))
    assert film.damaged == 7
    assert len(film.damage) == 1


def test_damaged_jpegs_of_a_multipart_stream_as_over_http_are_left_out(tmp_path: Path) -> None:
    parts = [cut(jpeg(number)) if number in ODD else jpeg(number) for number in range(FRAMES)]
    head = b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n"
    (tmp_path / "stream").write_bytes(
        b"".join(head % len(part) + part + b"\r\n" for part in parts) + b"--b--\r\n"
    )
    source = PlayedSource(
        f"filesrc do-timestamp=true location={tmp_path / 'stream'} blocksize=2000 "
        "! identity sleep-time=8000 ! multipartdemux boundary=b ! image/jpeg,framerate=30/1 "
        "! jpegdec",
        DeviceError("over"),
    )
    film = Film(source, FRAMES)
    assert film.numbers <= set(range(0, FRAMES, 2))
    assert film.damaged >= 10

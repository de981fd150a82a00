"""JPEG pictures as encoders and cameras make them, whole and with parts missing."""

from __future__ import annotations

import re
from random import Random
from typing import Any

import cv2
import pytest

from hw.gstreamer.damage import damage_of
from tams_app import gst
from tests.hw.gstreamer.damaged_videos import SIZE, hole, jpeg, not_a_picture, picture

pytestmark = pytest.mark.untimed


def encoded(*options: int) -> bytes:
    return bytes(cv2.imencode(".jpg", picture(1), options)[1].tobytes())


def by_gstreamer(chain: str) -> bytes:
    pipeline = gst.parse_pipeline(
        f"appsrc name=in format=time caps=video/x-raw,format=BGR,width={SIZE[0]},height={SIZE[1]},"
        f"framerate=30/1 ! videoconvert ! {chain} ! appsink name=out sync=false"
    )
    gst.set_playing(pipeline, "the encoder")
    pipeline.get_by_name("in").emit("push-buffer", gst.raw_buffer(picture(1).tobytes(), 0, 1))
    pipeline.get_by_name("in").emit("end-of-stream")
    sample: Any = pipeline.get_by_name("out").emit("pull-sample")
    data = gst.pixels_of(sample.get_buffer()).tobytes()
    gst.shut_down(pipeline)
    return data


def without_tables(data: bytes) -> bytes:
    """As UVC cameras send them: the Huffman tables are the standard's."""
    return data[: data.index(b"\xff\xc4")] + data[data.index(b"\xff\xda") :]


def padded(data: bytes) -> bytes:
    """As Logitech's cameras send them: some bytes too many before each restart marker."""
    size = Random(1)
    return re.sub(rb"(?=\xff[\xd0-\xd7])", lambda _: bytes(size.randrange(11)), data)


RESTARTS = encoded(cv2.IMWRITE_JPEG_RST_INTERVAL, 4)
WHOLE = {
    **{
        f"quality {quality}": encoded(cv2.IMWRITE_JPEG_QUALITY, quality) for quality in (30, 80, 99)
    },
    "restarts": RESTARTS,
    "optimised": encoded(cv2.IMWRITE_JPEG_OPTIMIZE, 1),
    "progressive": encoded(cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "4:2:2": by_gstreamer("video/x-raw,format=Y42B ! jpegenc"),
    "4:4:4": by_gstreamer("video/x-raw,format=Y444 ! jpegenc"),
    "grey": by_gstreamer("video/x-raw,format=GRAY8 ! jpegenc"),
    "libav": by_gstreamer("avenc_mjpeg"),
    "without tables, after others": without_tables(jpeg(1)),
    "padded restarts": padded(RESTARTS),
    "padded end": jpeg(1)[:-2] + bytes(3) + jpeg(1)[-2:],
    "restarts, and the end of an earlier picture": RESTARTS + RESTARTS[len(RESTARTS) // 2 :],
    "what follows": jpeg(1) + bytes(99) + b"left over",
}


@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_picture_is_never_called_damaged(name: str) -> None:
    assert damage_of(WHOLE[name]) == ""


@pytest.mark.parametrize(
    "name",
    [name for name in WHOLE if not name.startswith(("progressive", "padded r", "restarts,"))],
)
def test_a_hole_as_long_as_a_packet_is_mostly_found(name: str) -> None:
    data, at = WHOLE[name], Random(3)
    begin, end = data.rfind(b"\xff\xda") + 14, data.rfind(b"\xff\xd9")
    holes = [at.randrange(begin, end - 512) for _ in range(100)]
    assert sum(damage_of(data[:one] + data[one + 512 :]) != "" for one in holes) >= 85


def test_a_lost_restart_marker_is_found_in_padded_pictures_and_without_the_library(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data = padded(RESTARTS)
    third, fourth = data.index(b"\xff\xd2", 600), data.index(b"\xff\xd3", 600)
    assert damage_of(data[:third] + data[fourth:]) == "JPEG pictures lack a part"
    monkeypatch.setattr("hw.gstreamer.damage.turbojpeg", lambda: None)
    assert damage_of(data[:third] + data[fourth:]) == "JPEG pictures lack a part"
    assert damage_of(hole(jpeg(1))) == ""


def test_what_cannot_be_decoded_at_all_is_left_to_the_decoder() -> None:
    for data in (not_a_picture(jpeg(1)), b"", b"\xff\xd8\xff\xd9", jpeg(1)[:2] + jpeg(1)[-2:]):
        assert damage_of(data) in ("", "JPEG pictures lack their end")

"""Videos with damaged frames, as cameras, buses and disks deliver them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tams_app import gst
from tams_app.records import Image

SIZE = 160, 120
FPS = 30
JPEG = f"image/jpeg,width={SIZE[0]},height={SIZE[1]},framerate={FPS}/1"
_END_S = 60
Units = list[tuple[bytes, bool]]
"""Coded frames in order: each with whether it is predicted from others."""


def picture(number: int) -> Image:
    """Noise over all of it, another in each: what is filled in or left over shows."""
    noise = np.random.default_rng(number).integers(
        0, 255, (SIZE[1] // 4, SIZE[0] // 4, 3), np.uint8
    )
    return np.asarray(cv2.resize(noise, SIZE), np.uint8)


def jpeg(number: int) -> bytes:
    return bytes(cv2.imencode(".jpg", picture(number))[1].tobytes())


def cut(data: bytes) -> bytes:
    """Its second half did not arrive."""
    return data[: len(data) // 2]


def hole(data: bytes) -> bytes:
    """A USB packet within it was lost."""
    return data[: len(data) // 2] + data[len(data) // 2 + 512 :]


def not_a_picture(data: bytes) -> bytes:
    return data[:2] + bytes(len(data) - 4) + data[-2:]


def mjpeg(path: Path, frames: int, damage: Callable[[bytes], bytes], which: Iterable[int]) -> None:
    """An .mkv in which `which` of the JPEG pictures are damaged."""
    chosen = set(which)
    units = [damage(jpeg(number)) if number in chosen else jpeg(number) for number in range(frames)]
    write(path, JPEG, [(unit, False) for unit in units])


def h264_units(frames: int, keyframe_every: int) -> tuple[str, Units]:
    """The caps and the access units of a video without frames out of order."""
    Gst: Any = gst.load().Gst
    pipeline = gst.parse_pipeline(
        f"appsrc name=in format=time caps=video/x-raw,format=BGR,width={SIZE[0]},height={SIZE[1]},"
        f"framerate={FPS}/1 ! videoconvert ! video/x-raw,format=I420 "
        "! x264enc tune=zerolatency option-string=scenecut=0 "
        f"key-int-max={keyframe_every} "
        "! h264parse ! video/x-h264,stream-format=avc,alignment=au ! appsink name=out sync=false"
    )
    gst.set_playing(pipeline, "the encoder")
    source, sink = pipeline.get_by_name("in"), pipeline.get_by_name("out")
    for number in range(frames):
        data = picture(number).tobytes()
        source.emit("push-buffer", gst.raw_buffer(data, number * 10**9 // FPS, 10**9 // FPS))
    source.emit("end-of-stream")
    units: Units = []
    caps = ""
    while (sample := sink.emit("pull-sample")) is not None:
        buffer, caps = sample.get_buffer(), sample.get_caps().to_string()
        delta = buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)
        units.append((gst.pixels_of(buffer).tobytes(), delta))
    gst.shut_down(pipeline)
    return caps, units


def write(path: Path, caps: str, units: Units, times_s: Iterable[float] | None = None) -> None:
    """Coded frames in an .mkv, `times_s` after its beginning, by default FPS a second."""
    Gst: Any = gst.load().Gst
    times = [number / FPS for number in range(len(units))] if times_s is None else list(times_s)
    pipeline = gst.parse_pipeline("appsrc name=in format=time ! matroskamux ! filesink name=file")
    pipeline.get_by_name("file").set_property("location", str(path))
    source = pipeline.get_by_name("in")
    source.set_property("caps", Gst.Caps.from_string(caps))
    pipeline.set_state(Gst.State.PLAYING)
    for number, (data, delta) in enumerate(units):
        at_s, next_s = times[number], times[number + 1] if number + 1 < len(times) else None
        duration_s = 1 / FPS if next_s is None else next_s - at_s
        buffer = gst.raw_buffer(data, round(at_s * 10**9), round(duration_s * 10**9))
        buffer.dts = buffer.pts
        if delta:
            buffer.set_flags(Gst.BufferFlags.DELTA_UNIT)
        source.emit("push-buffer", buffer)
    source.emit("end-of-stream")
    kinds = Gst.MessageType.EOS | Gst.MessageType.ERROR
    message = pipeline.get_bus().timed_pop_filtered(_END_S * Gst.SECOND, kinds)
    gst.shut_down(pipeline)
    assert message.type == Gst.MessageType.EOS, message.parse_error()


def number_of(image: Image, among: int) -> int | None:
    """Which picture it is; None: it is not wholly one of the first `among`."""
    for number in range(among):
        apart = np.abs(image.astype(int) - picture(number)).reshape(12, 10, 16, 10, 3)
        if apart.mean(axis=(1, 3, 4)).max() < 40:
            return number
    return None

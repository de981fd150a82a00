"""From a log's bitstream back to pictures, with the decoder that the operator's receiver uses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import LogError
from tams_app.records import EncodedFrame, Image
from tams_app.runtime.clock import NS_PER_MS

_ELEMENTS = ("appsrc", "h264parse", "videoconvert", "appsink")
_UNDERWAY = 8  # frames inside the pipeline before one is waited for
_PATIENCE_NS = 500 * NS_PER_MS  # then the next goes in, for this one may yield no picture
_AT_THE_END_NS = 10_000 * NS_PER_MS


@dataclass(frozen=True, slots=True)
class Picture:
    """One view as it was at `capture_ns`: BGR, shape (height, width, 3)."""

    view: str
    capture_ns: int
    image: Image


def decode(frames: Iterator[EncodedFrame], config: VideoConfig, decoder: str) -> Iterator[Picture]:
    """The pictures of one view's access units; LogError if the decoder gives up.

    Each carries its capture time as PTS, by which a picture is known again.
    """
    gst.require_elements((*_ELEMENTS, decoder))
    threads = " max-threads=1" if decoder == "avdec_h264" else ""
    pipeline = gst.parse_pipeline(
        "appsrc name=units format=time max-bytes=0 "
        "caps=video/x-h264,stream-format=byte-stream,alignment=au "
        f"! h264parse ! {decoder}{threads} ! videoconvert n-threads=1 ! video/x-raw,format=BGR "
        "! appsink name=pictures sync=false max-buffers=0"
    )
    units, pictures = pipeline.get_by_name("units"), pipeline.get_by_name("pictures")
    gst.set_playing(pipeline, "decoding a recorded view")
    try:
        underway = 0
        view = ""
        for frame in frames:
            view = frame.view
            units.emit("push-buffer", gst.raw_buffer(frame.data, frame.capture_ns, 0))
            underway += 1
            if underway < _UNDERWAY:
                continue
            while sample := pictures.emit(
                "try-pull-sample", _PATIENCE_NS if underway >= _UNDERWAY else 0
            ):
                underway -= 1
                yield _picture(view, sample, config)
        units.emit("end-of-stream")
        while sample := pictures.emit("try-pull-sample", _AT_THE_END_NS):
            yield _picture(view, sample, config)
        if reason := gst.poll_bus(pipeline):
            raise LogError(f"the recorded view {view} cannot be decoded: {reason}")
    finally:
        gst.shut_down(pipeline)


def _picture(view: str, sample: Any, config: VideoConfig) -> Picture:
    buffer = sample.get_buffer()
    pixels = np.frombuffer(buffer.extract_dup(0, buffer.get_size()), np.uint8)
    image: Image = pixels.reshape(config.height, config.width, 3)
    return Picture(view, buffer.pts, image)

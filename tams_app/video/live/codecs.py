"""The decoding of a recorded view."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Any

from tams_app import gst
from tams_app.errors import UnreadableLogError
from tams_app.records import EncodedFrame
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import DECODER, DECODER_LAUNCH, Planes

_ELEMENTS = ("appsrc", "h264parse", "videoconvert", "appsink")
_UNDERWAY = 8  # frames inside the pipeline before one is waited for
_DECODING_NS = 500 * NS_PER_MS  # then the next goes in, for this one may yield no frame
_AT_THE_END_NS = 10_000 * NS_PER_MS


def decoded(units: Iterator[EncodedFrame]) -> Generator[tuple[int, Planes]]:
    """Capture time [ns] and I420 planes, flat, of one view's frames; from a keyframe on.

    UnreadableLogError if the decoder gives up, SetupError if there is none.
    """
    gst.require_elements((*_ELEMENTS, DECODER))
    pipeline = gst.parse_pipeline(
        "appsrc name=units format=time max-bytes=0 "
        "caps=video/x-h264,stream-format=byte-stream,alignment=au "
        f"! h264parse ! {DECODER_LAUNCH} "
        "! appsink name=frames sync=false max-buffers=0"
    )
    entry, frames = pipeline.get_by_name("units"), pipeline.get_by_name("frames")
    gst.set_playing(pipeline, "decoding a recorded view")
    try:
        underway = 0
        view = ""
        for unit in units:
            view = unit.view
            entry.emit("push-buffer", gst.raw_buffer(unit.data, unit.capture_ns, 0))
            underway += 1
            if underway < _UNDERWAY:
                continue
            while sample := frames.emit(
                "try-pull-sample", _DECODING_NS if underway >= _UNDERWAY else 0
            ):
                underway -= 1
                yield _frame(sample)
        entry.emit("end-of-stream")
        while sample := frames.emit("try-pull-sample", _AT_THE_END_NS):
            yield _frame(sample)
        if reason := gst.poll_bus(pipeline):
            raise UnreadableLogError(f"the recorded view {view} cannot be decoded: {reason}")
    finally:
        gst.shut_down(pipeline)


def _frame(sample: Any) -> tuple[int, Planes]:
    buffer = sample.get_buffer()
    return buffer.pts, gst.pixels_of(buffer)

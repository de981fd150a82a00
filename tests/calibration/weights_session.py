"""A recorded session whose every image can be known again: its stripes tell view and index."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tams_app import gst
from tams_app.config import VideoConfig, load_config
from tams_app.recording import Recorder
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.reference import ReferenceRecorder
from tams_app.records import EncodedFrame, Frame, Image, Phase, PhaseChange
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S
from tests.synthetic_session import FPS, START_NS, VIEWS, capture_ns, header, never_fails

WIDTH, HEIGHT = 160, 120
VIDEO = VideoConfig(width=WIDTH, height=HEIGHT)
_STRIPES = 8  # bits: six of the index, two of the view; black is 0
_STRIPE = WIDTH // _STRIPES  # [pixels]


def image_of(view: str, index: int) -> Image:
    """What `view` captured as number `index` < 64."""
    code = index + 64 * VIEWS.index(view)
    stripes = [255 * (code >> bit & 1) for bit in range(_STRIPES)]
    row = np.repeat(np.array(stripes, np.uint8), _STRIPE)
    return np.broadcast_to(row[np.newaxis, :, np.newaxis], (HEIGHT, WIDTH, 3)).copy()


def seen(image: Image) -> tuple[str, int]:
    """View and index of a image, also after encoding."""
    means = image.reshape(HEIGHT, _STRIPES, _STRIPE, 3).mean(axis=(0, 2, 3))
    code = sum(int(mean > 127) << bit for bit, mean in enumerate(means))
    return VIEWS[code // 64], code % 64


def encoded(view: str, count: int, keyframe_interval: int = 600) -> Iterator[EncodedFrame]:
    """`count` images through x264, as a sender does it: no B-frames."""
    pipeline = gst.parse_pipeline(
        "appsrc name=in format=time max-bytes=0 "
        f'caps="video/x-raw,format=BGR,width={WIDTH},height={HEIGHT},framerate={FPS}/1" '
        "! videoconvert ! video/x-raw,format=I420 ! x264enc tune=zerolatency threads=1 "
        f"pass=quant quantizer=20 key-int-max={keyframe_interval} option-string=scenecut=0 "
        "! video/x-h264,stream-format=byte-stream,alignment=au ! appsink name=out sync=false"
    )
    entrance, end = pipeline.get_by_name("in"), pipeline.get_by_name("out")
    gst.set_playing(pipeline, "encoding")
    for index in range(count):
        entrance.emit("push-buffer", gst.raw_buffer(image_of(view, index).tobytes(), index, 0))
        buffer = end.emit("pull-sample").get_buffer()
        data = buffer.extract_dup(0, buffer.get_size())
        t_ns = capture_ns(index)
        yield EncodedFrame(view, index, t_ns, t_ns + 1, index % keyframe_interval == 0, data)
    gst.shut_down(pipeline)


def record_session(
    folder: Path,
    phases: list[tuple[float, Phase]],
    seconds: float,
    network: str = "none",
    changes: dict[str, dict[str, object]] | None = None,
) -> Path:
    """A session folder with these phases (from when [s]), and `seconds` of video of each view.

    `changes`: by section, in the configuration that its header tells.
    """
    folder.mkdir(parents=True)
    config = load_config().model_copy(update={"video": VIDEO}).model_dump(mode="json")
    for section, keys in (changes or {}).items():
        config[section] |= keys
    head = replace(header(config=config), network=network)
    recorder = Recorder(McapLog(folder / "session.mcap", head), MonotonicClock(), never_fails)
    recorder.start()
    for start_s, phase in phases:
        recorder.record(PhaseChange(START_NS + round(start_s * NS_PER_S), phase, "by hand"))
    for view in VIEWS:
        for frame in encoded(view, round(seconds * FPS)):
            recorder.record(frame)
    recorder.close()
    return folder


def add_captures(folder: Path, count: int) -> None:
    """`count` ≤ 15 lossless captures of each view beside the log: the images sent, inverted."""
    offset_ns = header().wall_offset_ns
    recorder = ReferenceRecorder(folder / "reference.mcap", offset_ns, 0, never_fails)
    for index in range(count):
        for view in VIEWS:
            recorder.record(Frame(view, index, capture_ns(index), 255 - image_of(view, index)))
    recorder.start()
    recorder.close()
    assert recorder.dropped == 0

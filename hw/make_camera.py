"""The camera a configuration asks for."""

from __future__ import annotations

from hw.v4l2.camera import V4l2Source
from hw.v4l2.file_camera import FileSource, PatternSource
from hw.v4l2.gst_camera import FrameSource, GstCamera, Note
from tams_app.config import CameraConfig, VideoConfig
from tams_app.runtime.clock import Clock


def make_camera(
    view: str, config: CameraConfig, video: VideoConfig, clock: Clock, note: Note
) -> GstCamera:
    """The camera of `view`, not started yet; ConfigError if its settings cannot go together.

    `clock` must be CLOCK_MONOTONIC, by which the frames are timed. `note` is called with level
    and sentence, from the thread that calls next_frame, when the camera goes blind and comes back.
    """
    source: FrameSource
    if config.source == "file":
        source = FileSource(config.file, video)
    elif config.source == "pattern":
        source = PatternSource(video)
    else:
        source = V4l2Source(view, config, video)
    return GstCamera(view, source, video, clock, note)

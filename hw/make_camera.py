"""The camera a configuration asks for: one entry of `SOURCES` for each word of `source`."""

from __future__ import annotations

from collections.abc import Callable

from hw.gstreamer.camera import FrameSource, GstCamera
from hw.gstreamer.capture import FileSource, PatternSource
from tams_app.config import CameraConfig, VideoConfig
from tams_app.records import TakeNote
from tams_app.registry import Registry
from tams_app.runtime.clock import Clock

SOURCES: Registry[Callable[[str, CameraConfig, VideoConfig], FrameSource]] = Registry(
    "cameras.VIEW.source",
    "tams.cameras",
    {
        "v4l2": "hw.v4l2.source:V4l2Source",
        "file": lambda _view, config, video: FileSource(config.file, video),
        "pattern": lambda _view, _config, video: PatternSource(video),
    },
)
"""Makers of a source by their word for `cameras.VIEW.source`; entry points of `tams.cameras`.

Each is given the view's name, its camera's configuration and the stream's.
"""

NOT_LIVE = ("file", "pattern")  # sources that show no arm: a real one does not move by them


def make_camera(
    view: str, config: CameraConfig, video: VideoConfig, clock: Clock, note: TakeNote
) -> GstCamera:
    """Make the camera of one view.

    Args:
        view: the view's name; it is on every frame.
        config: `cameras.VIEW`; its `source` is a key of `SOURCES`.
        video: size [pixels] and rate [frames/s] of the frames.
        clock: CLOCK_MONOTONIC, by which the frames are timed.
        note: called with level and sentence when the camera stops delivering and when it is back,
            in the thread that calls `next_frame`.

    Returns:
        The camera, not started yet.

    Raises:
        ConfigError: its settings cannot go together, or there is no such source.
    """
    return GstCamera(view, SOURCES[config.source](view, config, video), video, clock, note)

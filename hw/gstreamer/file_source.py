"""Frames without a camera: a video file played again and again, or a test pattern."""

from __future__ import annotations

from pathlib import Path

from hw.gstreamer.capture import GstCapture
from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError


class FileSource:
    """A video file of any size and rate that GStreamer can play; its sound is left out.

    It is fitted into the view's frame with black borders. Played at its own speed: one of
    less than the view's frame rate leaves places on the time grid empty, of one with more some
    frames are left out.
    """

    noisy = False
    endless = False

    def __init__(self, path: str, video: VideoConfig) -> None:
        self._path = Path(path).expanduser()
        self._video = video

    @property
    def label(self) -> str:
        return str(self._path)

    def open(self) -> GstCapture:
        """Play from the start; DeviceError if there is no such file."""
        if not self._path.is_file():
            raise DeviceError(f"there is no video file {self._path}; set the camera's file")
        gst.require_elements(("decodebin",))
        return GstCapture(
            'filesrc name=file ! decodebin caps="video/x-raw" expose-all-streams=false',
            self._video,
            paced=True,
            properties={"file": {"location": str(self._path)}},
        )

    def complaints(self) -> list[str]:
        return []


class PatternSource:
    """Colour bars that wander, at exactly the view's frame rate."""

    noisy = False
    endless = True
    label = "test pattern"

    def __init__(self, video: VideoConfig) -> None:
        self._video = video

    def open(self) -> GstCapture:
        gst.require_elements(("videotestsrc",))
        video = self._video
        return GstCapture(
            "videotestsrc is-live=true pattern=smpte horizontal-speed=2 "
            f"! video/x-raw,format=I420,width={video.width},height={video.height},"
            f"framerate={video.fps}/1",
            video,
        )

    def complaints(self) -> list[str]:
        return []

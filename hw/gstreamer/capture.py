"""One opening of a camera: a GStreamer chain from a source to BGR frames with capture times."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hw.gstreamer.damage import DamageGate
from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError, SetupError
from tams_app.records import Image

_ELEMENTS = ("videoconvert", "videoscale", "appsink")


@dataclass(frozen=True, slots=True)
class RawFrame:
    """One frame as a chain delivers it."""

    capture_ns: int
    """When it was taken [ns], CLOCK_MONOTONIC."""
    pixels: Image
    """BGR, uint8, flat, row by row without padding: height · width · 3 values."""


class GstCapture:
    """A running GStreamer chain from a source to BGR frames of the view's size.

    Times: the pipeline runs on GStreamer's system clock, which is CLOCK_MONOTONIC, so a frame
    was taken at base time + running time of its buffer. v4l2src makes that the kernel's timestamp:
    with a USB camera the arrival of the frame's first data, after its exposure.
    The newest frame replaces one not pulled yet.
    """

    def __init__(
        self,
        source: str,
        video: VideoConfig,
        paced: bool = False,
        properties: dict[str, dict[str, Any]] | None = None,
    ) -> None:
        """Open and start.

        Args:
            source: a launch description (as of gst-launch-1.0) that ends in raw video.
            video: size [pixels] that the frames are scaled to.
            paced: the source does not keep time by itself, so frames are held until they are due.
            properties: by name of an element in `source`, for values that a description cannot
                quote.

        Raises:
            DeviceError: the source refuses at once, with its reason.
            SetupError: a GStreamer element is missing.
        """
        gst.require_elements(_ELEMENTS)
        Gst = gst.load().Gst
        self._pipeline = gst.Pipeline(_description(source, video, paced), "the capture chain")
        self._lacks = ""
        bus = self._pipeline.elements.get_bus()
        bus.enable_sync_message_emission()
        bus.connect("sync-message::element", self._on_element_message)
        self._sink = self._pipeline["frames"]
        self.gate = DamageGate(self._pipeline, self._sink)
        for element, values in (properties or {}).items():
            for name, value in values.items():
                self._pipeline[element].set_property(name, value)
        self._pipeline.elements.use_clock(Gst.SystemClock.obtain())
        try:
            self._pipeline.play()
        except SetupError as error:
            self.close()
            raise DeviceError(str(error)) from error

    def pull(self, timeout_ns: int) -> RawFrame | None:
        """Wait for the newest whole frame not pulled yet.

        Args:
            timeout_ns: how long at most [ns].

        Returns:
            The frame; None if none came in time or none will come (`ended`).
        """
        sample = self._sink.try_pull_sample(max(0, timeout_ns))
        if sample is None:
            return None
        Gst = gst.load().Gst
        buffer = sample.get_buffer()
        running_ns = sample.get_segment().to_running_time(Gst.Format.TIME, buffer.pts)
        if running_ns == Gst.CLOCK_TIME_NONE:
            reason = "its frames carry no times; put the video in a container like .mkv"
            self._pipeline.failure = reason
            return None
        capture_ns = self._pipeline.elements.get_base_time() + running_ns
        return RawFrame(capture_ns, gst.pixels_of(buffer))

    @property
    def ended(self) -> bool:
        """The source has no more frames, or failed."""
        return bool(self._sink.get_property("eos")) or bool(self.failure)

    @property
    def failure(self) -> str:
        """The cause for which there will be no more frames; "" if nothing went wrong."""
        pipeline = self._pipeline
        if not pipeline.failure and (reason := gst.poll_bus(pipeline.elements)):
            decoder = pipeline["decoder"]  # of a file
            if decoder and decoder.srcpads and not self._sink.sinkpads[0].get_current_caps():
                reason = "it has no video stream; choose another file"
            elif decoder:
                reason = f"it is damaged or not a video ({reason}); choose another file"
            pipeline.failure = self._lacks or reason
        return pipeline.failure

    def _on_element_message(self, _bus: Any, message: Any) -> None:
        lacks = gst.missing_plugin(message)
        if lacks and "audio/" not in lacks:
            self._lacks = lacks

    def close(self) -> None:
        """Let go of the source; may be called twice."""
        self._pipeline.close()


def _description(source: str, video: VideoConfig, paced: bool) -> str:
    """One thread converts, in the source's own; a live appsink needs async=false (FINDINGS 3)."""
    waiting = "sync=true" if paced else "sync=false async=false"
    return (
        f"{source} ! videoscale n-threads=1 add-borders=true ! videoconvert n-threads=1 "
        f"! video/x-raw,format=BGR,width={video.width},height={video.height},"
        f"pixel-aspect-ratio=1/1 ! appsink name=frames {waiting} max-buffers=1 drop=true"
    )


class FileSource:
    """A video file of any size and rate that GStreamer can play; its sound is left out.

    It is turned as its metadata ask, and fitted into the view's frame with black borders. Played at
    the times of its frames, pauses included: where they are farther apart than the view's, places
    on the time grid stay empty; where they are closer, some frames are left out.
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
        if not os.access(self._path, os.R_OK):
            raise DeviceError(f"you may not read the video file {self._path}; change its rights")
        gst.require_elements(("decodebin", "videoflip"))
        return GstCapture(
            "filesrc name=file ! decodebin name=decoder expose-all-streams=false "
            "! videoconvert n-threads=1 ! videoflip video-direction=auto",
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

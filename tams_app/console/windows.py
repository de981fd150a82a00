"""A window per view, which reads the receivers' mailboxes and never delays a frame."""

from __future__ import annotations

import os
import sys

import cv2

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import SetupError
from tams_app.records import Image, ShownFrame
from tams_app.units import NS_PER_S
from tams_app.video import pipelines

WINDOW_ELEMENTS = ("appsrc", "videoconvert", "autovideosink")
_LABEL_AT = (8, 20)
_WHITE, _BLACK = (255, 255, 255), (0, 0, 0)


class ViewWindow:
    """One view's window: appsrc → videoconvert → the display sink that GStreamer chooses.

    `show` never blocks: a window that is slower than the camera skips frames.
    """

    def __init__(self, view: str, config: VideoConfig) -> None:
        """SetupError if there is no display or GStreamer lacks an element."""
        require_display()
        gst.require_elements(WINDOW_ELEMENTS)
        self.view = view
        self.frames_shown = 0
        self._duration_ns = NS_PER_S // config.fps
        self._last_index: int | None = None
        self._failure = ""
        self._pipeline = gst.parse_pipeline(
            "appsrc name=frames is-live=true format=time block=false max-buffers=1 "
            f'leaky-type=downstream caps="{pipelines.raw_caps(config, "BGR")}" '
            "! videoconvert n-threads=1 ! autovideosink sync=false"
        )
        self._frames = self._pipeline.get_by_name("frames")

    def open(self) -> None:
        """Open the window; SetupError if the display refuses."""
        try:
            gst.set_playing(self._pipeline, f"the window of view {self.view}")
        except SetupError as error:
            self.close()
            raise SetupError(f"{error}; run with --headless to go without windows") from error

    def show(self, frame: ShownFrame) -> None:
        """Put `frame` on the screen with its view's name, unless it is there already."""
        if frame.index == self._last_index:
            return
        self._last_index = frame.index
        self.frames_shown += 1
        labelled = _labelled(frame.image, self.view)
        buffer = gst.raw_buffer(labelled, frame.shown_ns, self._duration_ns)
        self._frames.emit("push-buffer", buffer)

    def poll(self) -> str:
        """Why this window shows nothing any more, in one sentence; "" while it works.

        The operator closing it is such a reason; what follows from it is the session's affair.
        """
        if not self._failure:
            reason = gst.poll_bus(self._pipeline)
            if reason:
                self._failure = f"the window of view {self.view} was closed or failed: {reason}"
        return self._failure

    def close(self) -> None:
        """Close the window; may be called twice."""
        gst.shut_down(self._pipeline)


def _labelled(image: Image, view: str) -> Image:
    # GStreamer's display sinks give all windows one title: the name goes into the frame
    labelled = image.copy()
    for colour, thickness in ((_BLACK, 3), (_WHITE, 1)):
        cv2.putText(labelled, view, _LABEL_AT, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, thickness)
    return labelled


def require_display() -> None:
    """SetupError unless a display answers.

    Asked before autovideosink is: where none answers, its choice of glimagesink crashes the
    process (GStreamer 1.22), and the arm's control loop with it.
    """
    if sys.platform != "linux":
        return
    if os.environ.get("DISPLAY"):
        reason = _x_server_silent()
        if reason:
            raise SetupError(f"the display does not answer ({reason}); run with --headless")
    elif not os.environ.get("WAYLAND_DISPLAY"):
        raise SetupError("there is no display for the views' windows; run with --headless")


def _x_server_silent() -> str:
    """Why ximagesink, which fails in good order, cannot reach the X server; "" if it can."""
    gst.require_elements(("ximagesink",))
    Gst = gst.load().Gst
    probe = gst.parse_pipeline("fakesrc ! ximagesink")
    failed = probe.set_state(Gst.State.READY) == Gst.StateChangeReturn.FAILURE
    reason = gst.poll_bus(probe) if failed else ""
    gst.shut_down(probe)
    return reason

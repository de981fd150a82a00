"""Detection of a display, and of one that does not answer."""

from __future__ import annotations

import os

from tams_app import gst
from tams_app.errors import SetupError


def has_display() -> bool:
    """True if windows can be shown."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def require_display() -> None:
    """SetupError unless a display answers.

    Asked before autovideosink is: where none answers, its choice of glimagesink crashes the
    process (GStreamer 1.22), and the arm's control loop with it.
    """
    if os.environ.get("DISPLAY"):
        reason = _x_server_silent()
        if reason:
            raise SetupError(f"the display does not answer ({reason}); run with --headless")
    elif not os.environ.get("WAYLAND_DISPLAY"):
        raise SetupError("there is no display for a window; run with --headless")


def _x_server_silent() -> str:
    """The reason why ximagesink, which fails in good order, cannot reach the X server, or ""."""
    gst.require_elements(("ximagesink",))
    Gst = gst.load().Gst
    probe = gst.parse_pipeline("fakesrc ! ximagesink")
    failed = probe.set_state(Gst.State.READY) == Gst.StateChangeReturn.FAILURE
    reason = gst.poll_bus(probe) if failed else ""
    gst.shut_down(probe)
    return reason

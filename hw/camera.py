"""The interface of a camera: a source of frames with their true capture times."""

from __future__ import annotations

from abc import ABC, abstractmethod

from tams_app.records import Frame


class Camera(ABC):
    """One camera of 640x480 BGR frames at 30 frames per second."""

    view: str

    @abstractmethod
    def start(self) -> None:
        """Open the device; DeviceError with one sentence if it is not there."""

    @abstractmethod
    def next_frame(self, timeout_s: float) -> Frame | None:
        """The next frame not seen yet (older unread ones are skipped), or None after `timeout_s`.

        `Frame.index` is the frame's place on the camera's fixed time grid (30 per second from the
        camera's first frame), so a frame the camera missed leaves a gap. The image belongs to the
        caller.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device; may be called twice."""

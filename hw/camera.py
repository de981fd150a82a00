"""The interface of a camera: a source of frames with their true capture times."""

from __future__ import annotations

from abc import ABC, abstractmethod

from tams_app.records import Frame


class Camera(ABC):
    """One camera of 640x480 BGR frames at 30 frames per second."""

    view: str

    @abstractmethod
    def start(self) -> None:
        """Open the device.

        Raises:
            DeviceError: it is not there, or gives no frames of that size and rate.
        """

    @abstractmethod
    def next_frame(self, timeout_s: float) -> Frame | None:
        """The next frame that was not returned yet; older unread ones are skipped.

        Args:
            timeout_s: how long to wait for it [s].

        Returns:
            The frame, or None after `timeout_s`. `Frame.index` is its place on the camera's fixed
            time grid (30 per second from its first frame), so a frame that the camera missed leaves
            a gap. The image, shape (height, width, 3), belongs to the caller.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the device; may be called twice."""

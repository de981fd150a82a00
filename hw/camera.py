"""The interface of a camera: a source of frames with their true capture times."""

from __future__ import annotations

from abc import ABC, abstractmethod

from tams_app.records import Frame


class Camera(ABC):
    """One camera; `start` and `close` belong to one thread, `next_frame` to one other.

    Its size and rate are those of `video` in the configuration: 640x480 BGR at 30 frames/s.
    """

    view: str  # the name that its frames carry

    @abstractmethod
    def start(self) -> None:
        """Open the device and wait until it delivers.

        Raises:
            DeviceError: the device is not there or refuses, in one sentence.
        """

    @abstractmethod
    def next_frame(self, timeout_s: float) -> Frame | None:
        """The newest frame not returned yet; older ones not returned either are skipped.

        Args:
            timeout_s: how long to wait for one [s].

        Returns:
            The frame, or None if none came in time. `image` is BGR uint8, shape (height, width,
            3), and belongs to the caller. `capture_ns` is when it was taken (CLOCK_MONOTONIC).
            `index` is its place on the camera's time grid, `fps` places a second from its first
            frame on, or as many as the camera was commanded to give since: a frame that the camera
            missed leaves a gap, and no index comes twice.

        Raises:
            DeviceError: it was not started, or was closed.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the device; may be called twice."""

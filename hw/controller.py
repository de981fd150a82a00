"""The interface of a tracked, hand-held controller."""

from __future__ import annotations

from abc import ABC, abstractmethod

from tams_app.records import ControllerSample, Haptic


class Controller(ABC):
    """A 6-DoF controller with trigger, grip, two buttons and a menu button.

    Missing input is a `ControllerStatus` in the sample, never an exception: the safety logic
    turns it into a transition with a reason.
    """

    @abstractmethod
    def start(self) -> None:
        """Connect.

        Raises:
            DeviceError: there is nothing to connect to.
        """

    @abstractmethod
    def sample(self, now_ns: int) -> ControllerSample:
        """The newest reading; does not block.

        Args:
            now_ns: the instant [ns] it is for, by the monotonic clock.

        Returns:
            The pose in the tracking frame [m], the buttons, and when each was read.
        """

    @abstractmethod
    def pulse(self, haptic: Haptic) -> None:
        """Let the hand feel a pulse; does not block."""

    @abstractmethod
    def close(self) -> None:
        """Release the device; may be called twice."""

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the device and `sample`, by name."""
        return {}

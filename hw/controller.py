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
        """Connect to the device.

        Raises:
            DeviceError: there is nothing to connect to, in one sentence.
        """

    @abstractmethod
    def sample(self, now_ns: int) -> ControllerSample:
        """The newest reading; called at every control tick, so it must not block.

        Args:
            now_ns: the time of the tick [ns] on the session's clock.

        Returns:
            Status, pose (position [m], rotation; None unless it can be trusted), trigger and grip
            (0 to 1), buttons, and when pose and buttons were last new [ns].
        """

    @abstractmethod
    def pulse(self, haptic: Haptic) -> None:
        """Play a vibration pattern on the controller; does not block.

        Args:
            haptic: the event to be felt; a device without vibration ignores it.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the device; may be called twice."""

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the device and `sample`, by name."""
        return {}

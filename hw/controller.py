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
        """Connect; DeviceError with one sentence if there is nothing to connect to."""

    @abstractmethod
    def sample(self, now_ns: int) -> ControllerSample:
        """The newest reading at `now_ns`; does not block."""

    @abstractmethod
    def pulse(self, haptic: Haptic) -> None:
        """Let the hand feel something; does not block."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the device; may be called twice."""

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the device and `sample`, by name."""
        return {}

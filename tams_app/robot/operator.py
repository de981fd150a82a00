"""The operator's side as the robot's side knows it: the one port between the two."""

from __future__ import annotations

from abc import ABC, abstractmethod

from hw.controller import Controller
from tams_app.records import SteeredBy
from tams_app.robot.listener import Listener


class Operator(Listener, ABC):
    """The person or simulation that steers: at this computer, over a link, or in virtual time.

    As a `Listener` it is notified of each step of the session, last of all.
    """

    @abstractmethod
    def take_controller(self) -> Controller:
        """Start the controller; called once, after arm and guard have started.

        Returns:
            The controller in their hand, started.

        Raises:
            DeviceError: it is not there.
        """

    @property
    @abstractmethod
    def hand(self) -> str:
        """The kind of controller that drives the arm now, a key of `teleop.hands.HANDS`."""

    @property
    @abstractmethod
    def is_simulated(self) -> bool:
        """True if no person holds the controller, as far as is known."""

    @abstractmethod
    def steered_by(self, view: str) -> SteeredBy:
        """The frame that they can steer by now.

        Args:
            view: name of the view.

        Returns:
            When the newest whole frame on their screen was captured [ns], by the robot's clock, and
            whether a newer one is damaged.
        """

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the newest frame that counts.

        Args:
            view: name of the view.
            now_ns: the time [ns] by the robot's clock.

        Returns:
            The time since its capture [ns]; None before the first.
        """
        capture_ns = self.steered_by(view).capture_ns
        return None if capture_ns is None else now_ns - capture_ns

    def is_damaged(self, view: str) -> bool:
        """Test whether a newer frame is shown that does not count, as it is not whole.

        Args:
            view: name of the view.

        Returns:
            True if so.
        """
        return self.steered_by(view).is_damaged

"""The operator's side as the robot's side knows it: the one port between the two."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from hw.controller import Controller
from tams_app.records import SessionState, SteeredBy
from tams_app.robot.listener import Listener
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import ViewPorts


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


class StreamedOperator(Operator):
    """An operator to whom the video is streamed live; `open`, `connect`, in the end `close`."""

    @abstractmethod
    def open(
        self, rule: RepairRule, feedback: bool, sent: Mapping[str, SentFrames]
    ) -> dict[str, ViewPorts]:
        """Open the ports that video is received on.

        Args:
            rule: how lost packets are repaired.
            feedback: receivers report each packet.
            sent: by view, the identities of the frames that its sender has sent.

        Returns:
            By view, the ports that its packets go to, with 0 as the port for feedback.

        Raises:
            HelperError: a helper process did not start.
            ConfigError: an address or port cannot be bound.
            SetupError: the machine lacks something.
        """

    @abstractmethod
    def connect(self, entrances: Mapping[str, ViewPorts]) -> None:
        """Begin to receive.

        Args:
            entrances: by view, the ports that its receiver sends feedback to.
        """

    def wants_state(self, now_ns: int) -> bool:
        """Ask in each tick whether they are to be sent the session's state.

        Args:
            now_ns: the time of the tick [ns].

        Returns:
            True if `show` is to be called with it now; the next one is due by that.
        """
        return False

    def show(self, state: SessionState) -> None:
        """Send them the session's state; called in the control thread.

        Args:
            state: as the robot's side knows it.
        """

    def note(self, text: str) -> None:
        """Show a sentence to them; called from any thread.

        Args:
            text: one line.
        """

    @abstractmethod
    def poll(self) -> str:
        """Look for failures; called some 20 times a second.

        Returns:
            The first one in one sentence, "" while all works.
        """

    def end(self, reason: str, failed: bool) -> None:
        """Notify them that the session is over, once the control loop has ended.

        Args:
            reason: the cause, in one sentence.
            failed: True after a failure, False after an orderly end.
        """

    @abstractmethod
    def close(self) -> None:
        """Close all that was opened; may be called twice."""

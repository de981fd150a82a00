"""The operator's side as the robot's side knows it: the one port between the two."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from hw.controller import Controller
from tams_app.records import SteeredBy
from tams_app.robot.listener import Listener
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import ViewPorts


class Operator(Listener, ABC):
    """Who steers: at this computer, at the other end of a link, or simulated in virtual time.

    As a `Listener` it is told of each step of the session, last of all.
    """

    @abstractmethod
    def take_controller(self) -> Controller:
        """What they hold, started; DeviceError if it is not there. Once, after arm and guard."""

    @property
    @abstractmethod
    def hand(self) -> str:
        """What drives the arm now, of `teleop.hands.HANDS`."""

    @property
    @abstractmethod
    def is_simulated(self) -> bool:
        """Whether no person holds the controller, as far as is known."""

    @abstractmethod
    def steered_by(self, view: str) -> SteeredBy:
        """What they can steer by in this view now; its capture by the robot's clock."""

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the newest frame of `view` that counts [ns]; None before the first."""
        capture_ns = self.steered_by(view).capture_ns
        return None if capture_ns is None else now_ns - capture_ns

    def is_damaged(self, view: str) -> bool:
        """Whether they see a newer frame of `view`, which does not count: it is not whole."""
        return self.steered_by(view).is_damaged


class StreamedOperator(Operator):
    """An operator to whom the video is streamed live; `open`, `connect`, in the end `close`."""

    @abstractmethod
    def open(
        self, rule: RepairRule, feedback: bool, sent: Mapping[str, SentFrames]
    ) -> dict[str, ViewPorts]:
        """By view, where its packets go to, without a port for feedback.

        `rule`: how they are repaired. `feedback`: receivers tell of each packet. `sent`: what each
        view's sender remembers. HelperError, ConfigError or SetupError if it cannot be.
        """

    @abstractmethod
    def connect(self, entrances: Mapping[str, ViewPorts]) -> None:
        """By view, where what its receiver sends is to go: begin to receive."""

    def note(self, text: str) -> None:
        """A sentence that they should read; from any thread."""

    @abstractmethod
    def poll(self) -> str:
        """The first failure in one sentence, "" while all works."""

    def end(self, reason: str, failed: bool) -> None:
        """The session is over, and why; once the control loop has ended."""

    @abstractmethod
    def close(self) -> None:
        """End what was opened; may be called twice."""

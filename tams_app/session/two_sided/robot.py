"""The session on the robot's side: that of one computer, with the operator at the end of a link."""

from __future__ import annotations

from pathlib import Path

from hw.controller import Controller
from tams_app.config import Config, Network
from tams_app.errors import HelperError
from tams_app.link.gateway_client import Endpoint, Gateway
from tams_app.link.sealing import LONGEST_DATAGRAM_BYTES, MEDIA_OVERHEAD_BYTES
from tams_app.runtime.clock import Clock
from tams_app.session.listener import Listener
from tams_app.session.session import Session
from tams_app.session.two_sided.robot_link import RobotLink
from tams_app.session.two_sided.robot_video import RobotVideo
from tams_app.session.uplink import Senders
from tams_app.video.core.codecs import Codecs

# what is sent again is 2 bytes longer, a parity packet 7
LONGEST_RTP_BYTES = LONGEST_DATAGRAM_BYTES - MEDIA_OVERHEAD_BYTES - 7


class RobotSession(Session):
    """As a `Session`, but for the operator, who is at another computer."""

    operator_is_here = False

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        endpoint: Endpoint,
        arm_at_once: bool = False,
        dry_run: bool = False,
    ) -> None:
        """`endpoint`: where to listen for the operator's side."""
        super().__init__(for_robot(config), clock, folder, arm_at_once, dry_run)
        self._endpoint = endpoint
        self.link: RobotLink | None = None

    @property
    def waiting(self) -> bool:
        """Whether there is no operator now."""
        event = None if self.link is None else self.link.event
        return event is None or not event.connected or event.left

    def close(self) -> None:
        if self.link is not None:
            self._stack.callback(self._tell_the_end)
        super().close()

    def _tell_the_end(self) -> None:
        if self.link is not None:
            self.link.end(self._end_reason, bool(self.failure))

    def _make_video(self, network: Network, codecs: Codecs, helper_logs: Path) -> Senders:
        def gateway(welcome: bytes) -> Gateway:
            return Gateway("robot", self._endpoint, welcome, helper_logs)

        self.link = link = RobotLink(
            self.config, self._clock, self.signals, self._log, gateway, self._state_at
        )
        self._stack.callback(link.close)
        return RobotVideo(
            self.config,
            network,
            self._clock,
            self._log,
            self._quality.captured,
            helper_logs,
            self._on_packets,
            self._on_worker_failure,
            link,
            codecs,
        )

    def _make_controller(self) -> Controller:
        if self.link is None:
            raise HelperError("the link is not open")
        self._helpers["link"] = self.link.process
        return self.link.controller

    def _trial_is_limited(self) -> bool:
        return self.link is None or self.link.operator_is_simulated

    def _hand(self) -> str:
        return super()._hand() if self.link is None else self.link.hand

    def _listeners(self) -> tuple[Listener, ...]:
        return () if self.link is None else (self.link,)

    def _show_note(self, text: str) -> None:
        super()._show_note(text)
        if self.link is not None:
            self.link.note(text)


def for_robot(config: Config) -> Config:
    """The configuration of a session whose operator is at the other end of the link.

    A pose or a button is judged by its age at the operator's side; what the link may add until it
    is lost comes on top. A datagram carries at most 1200 bytes, which every path lets through.
    """
    video = config.video
    video = video.model_copy(update={"mtu_bytes": min(video.mtu_bytes, LONGEST_RTP_BYTES)})
    fresh, link = config.freshness, config.link
    freshness = fresh.model_copy(
        update={
            "hold_pose_ms": link.bridge_ms,
            "pose_frozen_ms": fresh.pose_frozen_ms + link.lost_after_ms,
            "buttons_ms": fresh.buttons_ms + link.lost_after_ms,
        }
    )
    return config.model_copy(update={"freshness": freshness, "video": video})

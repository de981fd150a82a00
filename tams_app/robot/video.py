"""The video that the robot's side sends, as its other parts know it: live, or in virtual time."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TypeAlias

from tams_app.config import Network
from tams_app.policy.allocation import Policy
from tams_app.policy.budget import BUDGETS
from tams_app.records import Frame, Phase, UplinkReport
from tams_app.robot.ground import Ground
from tams_app.units import NS_PER_MS
from tams_app.video.core.pacer import FlightBound, Pacer
from tams_app.video.core.packets import media_ssrc, parity_ssrc
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.protection import Protection
from tams_app.video.core.repair import RepairRule, repair_rule
from tams_app.video.core.rtcp import ReceivedFeedback, uplink_report
from tams_app.video.core.sender import StreamSettings, Uplink
from tams_app.video.live.networks import network_capacity

TakeFrame: TypeAlias = Callable[[Frame], None]


class Video(ABC):
    """All views of one session, from the camera's frame to its packets; `rule`: their repair."""

    def __init__(
        self,
        ground: Ground,
        network: Network,
        epoch_ns: int,
        captured: TakeFrame | None = None,
        real: bool = False,
    ) -> None:
        """A capacity trace of `network` begins at `epoch_ns`.

        `captured` gets each camera's frame before it is sent. `real`: the network is not only
        emulated.
        """
        config, video = ground.config, ground.config.video
        self.capacity = network_capacity(network, epoch_ns)
        budget = BUDGETS[config.policy.budget.mode]
        feedback = budget.receives_packets  # whether receivers report of each packet
        received = video.views if budget.receives_reports else ()
        self.rule = repair_rule(
            network, video.pli_min_interval_ms, video.repair, video.latency_bound_ms, real
        )
        self.delay_ns = video_delay_ns(network, self.rule)
        policy = Policy.of(config, self.capacity)
        start_kbps = policy.step(Phase.REACH, UplinkReport(epoch_ns, 0)).target_kbps
        self._streams = {
            view: StreamSettings(
                view,
                video,
                self.rule.rtx,
                start_kbps[view],
                policy.strategy.source_drop_below_kbps,
            )
            for view in video.views
        }
        protected = video.views if self.rule.parity else ()
        always = video.repair.parity == "on"
        self._protection = Protection(protected, network, self.rule, video.fps, always, real)
        most_kbps = config.policy.budget.max_kbps
        self._uplink = Uplink(
            {view: ReceivedFeedback(view, media_ssrc(video, view)) for view in received},
            feedback,
            {view: ViewParity(parity_ssrc(video, view), feedback) for view in protected},
            FlightBound(video.views, threading.Lock()) if feedback else None,
            Pacer(sum(start_kbps.values()), most_kbps, threading.Lock()) if feedback else None,
        )
        self._clock, self._log = ground.clock, ground.log
        self._captured = captured

    def protect(self, report: UplinkReport, target_kbps: Mapping[str, float]) -> None:
        """Choose the parity of each view for what was reported and the coming targets."""
        if not self._uplink.parity:
            return
        self._protection.observe(report)
        total_kbps = sum(target_kbps.values())
        for view, parity in self._uplink.parity.items():
            share = target_kbps[view] / total_kbps if total_kbps else 0.0
            parity.groups = self._protection.groups(
                view, share, parity.packets_per_frame, parity.changed_share
            )

    def push(self, frame: Frame) -> None:
        """Send a captured frame; each view from one thread."""
        self._log.capture(frame)
        if self._captured is not None:
            self._captured(frame)
        self._send(frame, self._exceeds_flight(frame.view))

    @abstractmethod
    def set_targets(self, target_kbps: dict[str, int]) -> None:
        """The wire rate each view is to meet from now on."""

    def bound_flight(
        self, limit_bytes: float, target_kbps: Mapping[str, float], capacity_kbps: float
    ) -> None:
        """So much may be under way from now on; where it is exceeded, frames are left out.

        `capacity_kbps` paces what leaves.
        """
        if self._uplink.flight is not None:
            self._uplink.flight.set(limit_bytes, target_kbps)
        if self._uplink.pacer is not None:
            self._uplink.pacer.set(capacity_kbps)

    @abstractmethod
    def pad(self, size_bytes: int) -> None:
        """Send so much padding now, which no view's target pays for."""

    def report(self, now_ns: int) -> UplinkReport:
        """The senders' knowledge of the uplink; each packet's arrival is in one report only."""
        return uplink_report(now_ns, self._wire_bytes(), tuple(self._uplink.received.values()))

    def _exceeds_flight(self, view: str) -> bool:
        flight, pacer = self._uplink.flight, self._uplink.pacer
        if flight is None:
            return False
        reported_ns = max(received.newest_sent_ns for received in self._uplink.received.values())
        sent_bytes, now_ns = self._wire_bytes(), self._clock.now_ns()
        waiting_bytes = 0.0 if pacer is None else pacer.waiting_bytes(now_ns)
        return flight.exceeded(view, now_ns, sent_bytes, reported_ns, waiting_bytes)

    @abstractmethod
    def _send(self, frame: Frame, left_out: bool) -> None: ...

    @abstractmethod
    def _wire_bytes(self) -> int:
        """IP datagram bytes sent so far, all views together."""


def video_delay_ns(network: Network, rule: RepairRule) -> int:
    """One-way latency plus jitter buffer: no frame is ever shown younger."""
    return round((network.latency_ms + rule.latency_ms) * NS_PER_MS)

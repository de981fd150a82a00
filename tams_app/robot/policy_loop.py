"""The policy loop: new targets 20 times a second, and at once when a phase begins; padding."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from tams_app.config import Config
from tams_app.policy.allocation import Policy
from tams_app.policy.weights import WeightMatrix
from tams_app.recording.journal import Journal
from tams_app.records import (
    PacketFate,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
    PolicyInputs,
    Record,
    UplinkReport,
    UplinkSummary,
)
from tams_app.robot.listener import Listener
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.uplink_figures import ReportedPackets

_PADDING_NS = 10 * NS_PER_MS  # trains shorter than the queue that a budget looks for
_NEVER_NS = 1 << 62


class PolicyLoop(Listener):
    """Owner of the policy: turns the newest phase into targets of `video`; the body of a Worker."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        video: Video,
        log: Journal,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`listeners` get what is known of the uplink, and each allocation once the encoders have
        it.
        """
        self._policy = Policy.of(config, video.capacity)
        self._period_ns = round(NS_PER_S / config.policy.rate_hz)
        self._step_ns = clock.now_ns()  # when the next one is due, unless a phase begins before
        budget = self._policy.budget
        self._keeps_inputs = budget.receives_reports
        # when padding is due next
        self._pad_ns = self._step_ns if budget.receives_packets else _NEVER_NS
        self._clock = clock
        self._video = video
        self._log = log
        self._listeners = tuple(listeners)
        self._reported = ReportedPackets()
        self._phase, self._pinned = Phase.REACH, ""
        self._weights = WeightMatrix(config.policy.weights.matrix)
        self._woken = threading.Event()

    @property
    def due_ns(self) -> int:
        """The time [ns] of the next step or padding, unless a phase begins before."""
        return min(self._step_ns, self._pad_ns)

    def receive(self, record: Record) -> None:
        """Wake the loop for a new phase or a newly pinned view."""
        if isinstance(record, PhaseChange):
            self._phase = record.phase
            self._woken.set()
        elif isinstance(record, PinnedView):
            self._pinned = record.view
            self._woken.set()

    def run(self, stop: threading.Event) -> None:
        self._step_ns = self._clock.now_ns()
        while not stop.is_set():
            self.step_if_due()
            self._woken.wait((self.due_ns - self._clock.now_ns()) / NS_PER_S)

    def step_if_due(self) -> None:
        """Do what is due: an allocation, at once where a phase has begun; padding."""
        now_ns = self._clock.now_ns()
        if self._woken.is_set():
            self._woken.clear()
            self._step_ns = now_ns
        if now_ns >= self._step_ns:
            self._step_ns = max(self._step_ns + self._period_ns, now_ns)
            self._step(now_ns)
        if now_ns >= self._pad_ns:
            self._pad_ns = now_ns + _PADDING_NS
            if size_bytes := self._policy.budget.padding_bytes(now_ns):
                self._video.pad(size_bytes)

    def _step(self, now_ns: int) -> None:
        self._log.capacity(now_ns, self._video.capacity)
        report = self._video.report(now_ns)
        if report.arrivals or report.receptions:
            self._hand_on(summary_of(report, self._reported.step(report.arrivals)))
        if self._keeps_inputs:
            self._hand_on(PolicyInputs.of(report))
        allocation = self._policy.step(self._weights.row_phase(self._phase, self._pinned), report)
        self._video.protect(report, allocation.target_kbps)
        limit_bytes = self._policy.budget.flight_limit_bytes(now_ns)
        self._video.bound_flight(limit_bytes, allocation.target_kbps, allocation.capacity_kbps)
        self._video.set_targets(allocation.target_kbps)
        self._hand_on(allocation)

    def _hand_on(self, record: Record) -> None:
        for listener in self._listeners:
            listener.receive(record)


def summary_of(report: UplinkReport, reported: Sequence[PacketRecord]) -> UplinkSummary:
    """The sums of a report of the uplink; `reported`: its arrivals (`ReportedPackets`)."""
    came = [one for one in reported if one.fate is PacketFate.DELIVERED]
    newest = came[-1] if came else None
    return UplinkSummary(
        t_ns=report.now_ns,
        sent_bytes=report.sent_bytes,
        packets=len(reported),
        lost=len(reported) - len(came),
        arrived_bytes=sum(one.size_bytes for one in came),
        newest_sent_ns=None if newest is None else newest.entered_ns,
        queueing_ns=None if newest is None else newest.departed_ns - newest.entered_ns,
        fraction_lost={one.view: one.fraction_lost for one in report.receptions},
        round_trip_ns={one.view: one.round_trip_ns for one in report.receptions},
    )

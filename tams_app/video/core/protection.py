"""The views with parity, and how much: where it saves more quality than its bytes cost.

All parity is paid for by the view's own target, so the question is asked view by view: what share
of the frames is damaged without it and with it, what a damaged frame costs there, and what the
image loses by the bits that the parity takes. The answer counts by the view's share of all bits,
and must be worth a change. The constants were measured (FINDINGS 5, docs/MEASUREMENTS.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from tams_app.config import Network
from tams_app.records import UplinkReport
from tams_app.units import NS_PER_MS
from tams_app.video.core.repair import MARGIN_MS, RepairRule

# SSIM that a damaged frame costs: where nothing moves it is the keyframe, which must make a good
# image from the bits of one frame; then what changed of the image since the frame before.
STILL_DAMAGE, DAMAGE_OF_CHANGE, MOST_DAMAGE = 0.13, 2.0, 0.4
SSIM_PER_LOG_RATE = 0.06  # of the received image, where the bits change by a factor of e
_MOST_GROUPS = 4
_WORTH_A_CHANGE = 0.004  # SSIM, by the view's share
_REMEMBERED_PACKETS = 2000.0
_PRIOR_PACKETS = 200.0  # what the configured network counts for
_PACKETS_OF_A_RECEPTION = 20.0
_LONGER = 1.01  # each report: a route that has become longer is believed within seconds


@dataclass(frozen=True, slots=True)
class Loss:
    """Share of packets lost, and of those at which more than 0, 1, ... in a row are lost.

    The second is not of one kind: a radio loses single packets where a queue that overflows loses
    many in a row, and a parity packet brings back the first whatever becomes of the others.
    """

    rate: float
    longer: tuple[float, ...]  # bursts longer than so many, a packet

    @classmethod
    def of(cls, rate: float, mean_burst: float) -> Loss:
        """Of bursts whose length is geometric (Gilbert's model)."""
        going_on = 1.0 - 1.0 / mean_burst
        return cls(rate, tuple(rate / mean_burst * going_on**n for n in range(_MOST_GROUPS + 1)))

    @property
    def mean_burst(self) -> float:
        return max(self.rate / self.longer[0], 1.0) if self.longer[0] else 1.0


class LossEstimate:
    """The loss of one view: what its receiver reported lately; prior: the configured network."""

    def __init__(self, prior: Loss) -> None:
        self._packets = _PRIOR_PACKETS
        self._lost = prior.rate * _PRIOR_PACKETS
        self._longer = [share * _PRIOR_PACKETS for share in prior.longer]
        self._in_a_row = 0

    @property
    def loss(self) -> Loss:
        return Loss(self._lost / self._packets, tuple(n / self._packets for n in self._longer))

    def arrival(self, lost: bool) -> None:
        """Take in the fate of the next packet, in the order of sending."""
        self._forget(1.0)
        self._packets += 1
        if not lost:
            self._in_a_row = 0
            return
        self._lost += 1
        if self._in_a_row < len(self._longer):
            self._longer[self._in_a_row] += 1
        self._in_a_row += 1

    def reception(self, fraction_lost: float) -> None:
        """A report block: it gives the rate alone."""
        now = self.loss
        bursts = Loss.of(fraction_lost * _PACKETS_OF_A_RECEPTION, now.mean_burst)
        self._forget(_PACKETS_OF_A_RECEPTION)
        self._packets += _PACKETS_OF_A_RECEPTION
        self._lost += bursts.rate
        self._longer = [n + more for n, more in zip(self._longer, bursts.longer, strict=True)]

    def _forget(self, packets: float) -> None:
        kept = 1.0 - packets / _REMEMBERED_PACKETS
        self._packets, self._lost = self._packets * kept, self._lost * kept
        self._longer = [n * kept for n in self._longer]


def share_incomplete(packets: float, groups: int, loss: Loss) -> float:
    """The share of frames that stay incomplete: of `packets` each, with `groups` parity packets.

    A frame is lost by a burst longer than the groups are many, or by two bursts of which both hit
    one group.
    """
    starts = loss.longer[0]
    if groups == 0:
        return 1.0 - math.pow(1.0 - starts, packets)
    sent = packets + groups
    by_one = sent * loss.longer[groups]
    by_two = sent * (sent - 1) / 2 * starts**2 / groups
    return min(1.0, by_one + by_two)


class Protection:
    """The number of parity packets a frame for every view, decided anew as often as it is asked."""

    def __init__(
        self,
        views: Iterable[str],
        network: Network,
        rule: RepairRule,
        fps: int,
        always: bool,
        real: bool = False,
    ) -> None:
        """`always`: every view gets one at least.

        `real`: `network` is what is configured for a real one, whose round trip is measured.
        Where resends come in time, there is no other parity than that of `always`.
        """
        views = tuple(views)
        prior = Loss.of(network.loss, network.loss_burst)
        self._estimates = {view: LossEstimate(prior) for view in views}
        self._groups = dict.fromkeys(views, 0)
        self._least_groups = int(always)
        self._rule, self._fps, self._real = rule, fps, real
        self._round_trip_ms = 2.0 * network.latency_ms
        self._is_measured = False

    def observe(self, report: UplinkReport) -> None:
        """Take in what the receivers reported; arrivals say more than their report blocks."""
        if self._real and report.arrivals:
            newest_ns = max(arrival.sent_ns for arrival in report.arrivals)
            self._measure((report.now_ns - newest_ns) / NS_PER_MS)
        for arrival in report.arrivals:
            self._estimates[arrival.view].arrival(arrival.arrived_ns is None)
        if not report.arrivals:
            for reception in report.receptions:
                self._estimates[reception.view].reception(reception.fraction_lost)

    def _measure(self, trip_ms: float) -> None:
        """Follow the fastest round trips, which are the network's without queue and jitter."""
        longest_ms = _LONGER * self._round_trip_ms if self._is_measured else math.inf
        self._round_trip_ms, self._is_measured = min(trip_ms, longest_ms), True

    @property
    def _resends_come_in_time(self) -> bool:
        return self._rule.rtx and self._round_trip_ms + MARGIN_MS <= self._rule.latency_ms

    def groups(self, view: str, share: float, packets: float, changed: float) -> int:
        """The parity packets of each of the view's frames from now on.

        Args:
            view: its name.
            share: of all bits that go to it now, which is the weight it has in the phase.
            packets: media packets of a frame, with the parity that it has now.
            changed: share of its image that changes from frame to frame.
        """
        if self._real and self._resends_come_in_time:
            self._groups[view] = self._least_groups
            return self._least_groups
        loss = self._estimates[view].loss
        sent = packets + self._groups[view]  # what the target pays for, whatever it is
        most_groups = min(_MOST_GROUPS, max(1, math.floor(sent / 2)))
        costs = [self._cost(groups, sent, changed, loss) for groups in range(most_groups + 1)]
        best = min(range(self._least_groups, len(costs)), key=costs.__getitem__)
        now = min(self._groups[view], len(costs) - 1)
        if now < self._least_groups or share * (costs[now] - costs[best]) >= _WORTH_A_CHANGE:
            self._groups[view] = best
        return self._groups[view]

    def _cost(self, groups: int, sent: float, changed: float, loss: Loss) -> float:
        """Received SSIM lost by damage and by the bits that parity takes of the `sent` packets."""
        packets = max(sent - groups, 0.5)
        # From a loss to the keyframe that repairs it: it is noticed, asked for, and comes.
        refresh_ms = self._rule.latency_ms + self._round_trip_ms + 1000 / self._fps
        hit = refresh_ms * self._fps / 1000 * share_incomplete(packets, groups, loss)
        damage = min(STILL_DAMAGE + DAMAGE_OF_CHANGE * changed, MOST_DAMAGE)
        return damage * hit / (1.0 + hit) + SSIM_PER_LOG_RATE * math.log(sent / packets)

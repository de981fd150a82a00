"""The emulated uplink: one bottleneck for all views, then delay and jitter, then loss.

Analytic: when a packet enters, its fate and its times are computed at once, so the same object
serves the relay process live and a run in virtual time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from random import Random

from tams_app.capacity import Capacity
from tams_app.config import Network
from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS


class Bottleneck:
    """A FIFO queue with tail drop in front of a `Capacity`.

    Room is for `queue_ms` at the rate of the moment, at least for `queue_min_bytes`; the packet
    being sent counts until its last bit has left.
    """

    def __init__(self, capacity: Capacity, queue_ms: float, queue_min_bytes: int) -> None:
        self._capacity = capacity
        self._queue_ms = queue_ms
        self._queue_min_bytes = queue_min_bytes
        self._queue: deque[tuple[int, int]] = deque()  # (departure, size), oldest first
        self._free_ns = 0  # when the last accepted packet has left
        self.backlog_bytes = 0

    def room_bytes(self, now_ns: int) -> float:
        by_time = self._capacity.rate_kbps(now_ns) * self._queue_ms / 8  # kbit/s · ms = bit
        return max(by_time, self._queue_min_bytes)

    def enter(self, now_ns: int, size_bytes: int) -> int | None:
        """The time when the packet will have left [ns], or None if the queue is full."""
        while self._queue and self._queue[0][0] <= now_ns:
            self.backlog_bytes -= self._queue.popleft()[1]
        if self.backlog_bytes + size_bytes > self.room_bytes(now_ns):
            return None
        departed_ns = self._capacity.finish_ns(max(now_ns, self._free_ns), 8 * size_bytes)
        self._free_ns = departed_ns
        self._queue.append((departed_ns, size_bytes))
        self.backlog_bytes += size_bytes
        return departed_ns


class IndependentLoss:
    """Every packet is lost with the same probability."""

    def __init__(self, probability: float, random: Random) -> None:
        self._probability = probability
        self._random = random

    def lost(self) -> bool:
        return self._random.random() < self._probability


class GilbertElliottLoss:
    """Bursts: a two-state Markov chain over packets that loses all in its bad state, else none.

    `probability` is the long-run share lost, `mean_burst` the mean number of packets lost in a
    row: P(bad→good) = 1/mean_burst, P(good→bad) = probability / (mean_burst·(1−probability)).
    The chain starts in its stationary distribution. ValueError if no such chain exists.
    """

    def __init__(self, probability: float, mean_burst: float, random: Random) -> None:
        self._random = random
        self._recover = 1.0 / mean_burst
        self._fail = good_to_bad(probability, mean_burst)
        if self._fail > 1:
            raise ValueError("so much loss cannot come in such short bursts")
        self._bad = random.random() < probability

    def lost(self) -> bool:
        fate = self._bad
        threshold = 1.0 - self._recover if self._bad else self._fail
        self._bad = self._random.random() < threshold
        return fate


def good_to_bad(probability: float, mean_burst: float) -> float:
    """P(good→bad) of the chain with this long-run loss and mean burst; > 1 if there is none."""
    if probability >= 1:
        return 1.0
    return probability / (mean_burst * (1.0 - probability))


def loss_model(
    probability: float, mean_burst: float, random: Random
) -> IndependentLoss | GilbertElliottLoss:
    """Independent loss for a mean burst of 1, Gilbert-Elliott above."""
    if mean_burst == 1 or probability in (0, 1):
        return IndependentLoss(probability, random)
    return GilbertElliottLoss(probability, mean_burst, random)


class _Draws:
    """Delay and loss of one stream's packets in turn, each from its own seeded sequence.

    Both are drawn for every packet, also for one that overflowed, so that the n-th packet of a
    stream meets the same fate whatever the queue and the other streams did.
    """

    def __init__(self, network: Network, seed: int, name: str) -> None:
        self._latency_ms = network.latency_ms
        self._jitter_ms = network.jitter_ms
        self._jitter = Random(f"{seed}/{name}/jitter")
        random = Random(f"{seed}/{name}/loss")
        self.lost = loss_model(network.loss, network.loss_burst, random).lost

    def delay_ns(self) -> int:
        delay_ms = self._latency_ms + self._jitter_ms * self._jitter.uniform(-1.0, 1.0)
        return max(0, round(delay_ms * NS_PER_MS))


class Link:
    """The uplink of one session, and its way back for RTCP.

    Forward: bottleneck, delay uniform in latency ± jitter, loss. Delivery keeps the order of
    departure over all views, as one radio does: delivered = max(previous delivery, departed + d).
    A packet with a long draw therefore holds up those behind it, lost or not: with many packets
    per jitter span the mean delay lies between latency and latency + jitter.

    Loss and jitter of a view's RTP packets (media and repair alike) are drawn per ordinal from
    the view's own sequences; sender reports cross the same bottleneck but draw from sequences of
    their own, so that their timing never shifts the fate of video. Feedback goes back with the
    same delay and jitter, in order, without loss and not through the bottleneck.
    """

    def __init__(
        self, network: Network, capacity: Capacity, views: Iterable[str], seed: int
    ) -> None:
        """`capacity`: of the bottleneck; see `networks.network_capacity`.

        The same `seed` gives the n-th packet of a stream the same delay and loss.
        """
        views = tuple(views)
        self._bottleneck = Bottleneck(capacity, network.queue_ms, network.queue_min_bytes)
        self._rtp = {view: _Draws(network, seed, f"{view}/rtp") for view in views}
        self._reports = {view: _Draws(network, seed, f"{view}/reports") for view in views}
        self._feedback = {view: _Draws(network, seed, f"{view}/feedback") for view in views}
        self._now_ns = 0
        self._delivered_ns = 0
        self._returned_ns = 0

    def offer(
        self,
        now_ns: int,
        view: str,
        kind: PacketKind,
        size_bytes: int,
        sequence: int,
        rtp_timestamp: int = 0,
    ) -> PacketRecord:
        """Send a datagram into the uplink; its record: its fate, and when it leaves and arrives.

        `now_ns`, on the clock of `capacity`, never decreases (ValueError). `size_bytes`: with IP
        and UDP headers. `sequence`: of the media packet it carries; it and the timestamp are 0 for
        RTCP.
        """
        if now_ns < self._now_ns:
            raise ValueError("packets must be offered in the order of time")
        self._now_ns = now_ns
        draws = (self._reports if kind is PacketKind.RTCP else self._rtp)[view]
        delay_ns, lost = draws.delay_ns(), draws.lost()
        departed_ns = self._bottleneck.enter(now_ns, size_bytes)
        delivered_ns = 0
        if departed_ns is None:
            departed_ns, fate = 0, PacketFate.OVERFLOW
        else:
            self._delivered_ns = max(self._delivered_ns, departed_ns + delay_ns)
            fate = PacketFate.LOST if lost else PacketFate.DELIVERED
            delivered_ns = 0 if lost else self._delivered_ns
        return PacketRecord(
            view=view,
            kind=kind,
            sequence=sequence,
            size_bytes=size_bytes,
            entered_ns=now_ns,
            departed_ns=departed_ns,
            delivered_ns=delivered_ns,
            fate=fate,
            rtp_timestamp=rtp_timestamp,
        )

    def feedback(self, now_ns: int, view: str) -> int:
        """The arrival [ns] at the sender of a view's RTCP that the receiver sends at `now_ns`."""
        self._returned_ns = max(self._returned_ns, now_ns + self._feedback[view].delay_ns())
        return self._returned_ns

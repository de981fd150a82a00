"""The budget from per-packet feedback of all views together (docs/BUDGET.md)."""

from __future__ import annotations

import math
from collections import deque
from enum import Enum
from itertools import pairwise

from tams_app.capacity import Capacity
from tams_app.config import PolicyConfig
from tams_app.policy.budget import Budget
from tams_app.policy.budget.deliveries import Deliveries
from tams_app.policy.budget.queueing_delay import WINDOW_NS, QueueingDelay
from tams_app.records import Phase, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

_SHOWS = 1.5  # times the target: a queue, not jitter
_LEAST_TARGET_NS = 4 * NS_PER_MS  # where there is no jitter: a third of a frame's own time
_DISPERSED = 0.5  # arrived / sent: the bottleneck carries less than the pacer let go at the start
_FIRST_EXCESS = 25.0  # times the target: doubles the rate, as slow start does
_EXCESS_OF_KNOWN = 4.0  # once the first frames have shown a rate
_USED = 0.6  # share of the estimate below which the views, not the link, limit what is sent
_MOST_PADDING = 0.3  # share of what is allowed that a probe pads where views make less
_CARRIED = 0.8  # of what was sent: less of it shows the limit, a queue alone may be jitter
_LEAST_GROWTH, _MOST_GROWTH = 1.4, 2.0  # of what is allowed, in one probe
_UNHEARD_NS = 100 * NS_PER_MS  # of queue, until growth beyond the capacity is heard: most hold more
_LEAST_SHARE = 0.2  # of the estimate, while a queue is let run empty
_STUCK = 4  # spans after which a queue of our own would have gone
_RADIO_LOSS = 0.02  # radio links lose less without a queue
_LEAST_KBPS = 60.0
_FIRST_FLIGHT_BYTES = 6_000.0  # before the first report: two frames of each view at the floors

# Beside a flow that fills the queue; Cubic, too, grows by more than a packet in a round trip.
_PACKET_BITS, _PACKETS = 8 * 1240, 2
_SHARED_NS = 20 * NS_PER_S  # before it is asked whether the other is still there
_CUT = 0.7  # after loss, as Cubic's (RFC 9438)

_TRIP_UP, _TRIP_DOWN = 0.2, 0.02  # near the longest: jitter is not to leave frames out
_HISTORY_NS = 3 * NS_PER_S


class _Phase(Enum):
    PROBE = "more than the estimate is sent, so that the target would stand as a queue"
    DRAIN = "less than the estimate is sent, so that delays without a queue are seen"
    SHARE = "another flow fills the queue: as TCP does"


class FeedbackBudget(Budget):
    """Keeps in flight what the path carries in its base round trip, and a small target delay.

    What it carries is the rate of delivery while packets arrive slower than they were sent, and at
    least any rate at which they arrived as they were sent. The queue is a low quantile of delays
    above the same quantile of ten seconds, the target how far delays lie apart.

    In turn it probes, so that the target would stand as a queue, and drains, so that the base is
    seen again. A probe that shows no queue is followed by one of twice the excess. A queue that
    does not go although less is sent is none of ours: the base has changed if it stands, another
    flow fills it if it moves. What is sent is not limited by floors: these are the views'.
    """

    receives_packets = True

    def __init__(self, policy: PolicyConfig, capacity: Capacity) -> None:
        """The estimate begins at what the views have together at least."""
        super().__init__(policy, capacity)
        config, views = policy.budget, policy.weights.matrix[Phase.REACH]
        floors_kbps = len(views) * policy.allocation.floor_kbps
        self._max_kbps = config.max_kbps
        self._most_target_ns = config.delay_target_ms * NS_PER_MS
        self._spare = 1.0 - config.safety_factor
        self._kbps = min(config.max_kbps, floors_kbps / config.safety_factor)
        self._allowed_kbps = self._kbps
        self._delay = QueueingDelay()
        self._deliveries = Deliveries()
        self._sent: deque[tuple[int, int]] = deque()  # (time, bytes since the start), by steps
        self._views_sent: deque[tuple[int, int]] = deque(maxlen=8)  # without padding
        self._padded_bytes = 0
        self._phase, self._phase_ns = _Phase.PROBE, 0
        self._excess = _FIRST_EXCESS  # of the probe, times the target
        self._most_queue_ns = 0  # in the probe
        self._most_sent_kbps = 0.0  # and since
        self._limited = False  # a probe has found what the path carries
        self._probed_kbps = self._kbps  # the estimate when it began
        self._levels_ns: tuple[int, int] | None = None  # least and largest, of a queue that stays
        self._own_base_ns = self._cut_ns = 0  # of sharing: the base without the other, the last cut
        self._base_trip_ns = 2.5 * WINDOW_NS  # from sending to the report of it, without a queue
        self._target_ns = 0.0
        self._began_ns: int | None = None  # with the first report
        self._window_ns = WINDOW_NS  # in which a queue is to come to its target
        self._resumed_ns = -1  # after silence: what was sent before says nothing of the link
        self._pending = self._news = self._silent = False
        self._stepped_ns = self._reported_ns = self._padded_ns = 0

    def observe(self, report: UplinkReport) -> None:
        if not self._sent:
            self._stepped_ns = self._reported_ns = self._phase_ns = report.now_ns
        new = self._deliveries.take(report.arrivals)
        for packet in new:
            if packet.arrived_ns is not None and packet.sent_ns > self._resumed_ns:
                self._delay.add(packet.sent_ns, packet.arrived_ns)
        self._news = self._news or bool(new)
        if self._sent and self._sent[-1][0] == report.now_ns:
            self._sent.pop()
            self._views_sent.pop()
        self._sent.append((report.now_ns, report.sent_bytes))
        self._views_sent.append((report.now_ns, report.sent_bytes - self._padded_bytes))
        while self._sent[0][0] < report.now_ns - _HISTORY_NS:
            self._sent.popleft()
        self._pending = True

    def capacity_kbps(self, now_ns: int) -> float:
        if self._pending:
            elapsed_ns, self._stepped_ns = now_ns - self._stepped_ns, now_ns
            if self._news:
                self._hear(now_ns, elapsed_ns)
            elif self._is_silent(now_ns):
                self._decay(elapsed_ns)
            self._pending = self._news = False
        return self._allowed_kbps

    def padding_bytes(self, now_ns: int) -> int:
        since_ns = min(now_ns - self._padded_ns, WINDOW_NS)
        if since_ns < (WINDOW_NS if self._silent else WINDOW_NS // 5):
            return 0
        self._padded_ns = now_ns
        padding = int(self._padding_kbps() * since_ns / 8e6)
        self._padded_bytes += padding
        return padding

    def flight_limit_bytes(self, now_ns: int) -> float:
        if self._began_ns is None:
            return _FIRST_FLIGHT_BYTES
        trip_ns = self._base_trip_ns + self._target_ns + self._window_ns // 2
        return max(self._kbps, self._allowed_kbps) * trip_ns / 8e6

    def _padding_kbps(self) -> float:
        """The padding that a probe needs beside the views, more the longer the link seems free."""
        if self._silent:
            return self._spare * self._allowed_kbps
        if self._began_ns is None or self._phase is not _Phase.PROBE:
            return 0.0
        views_kbps = self._views_kbps()
        unused = self._excess <= 1.0 and views_kbps < _USED * self._kbps
        if unused or self._kbps >= self._max_kbps:
            return 0.0  # nothing is to be found out
        most_kbps = min(_MOST_PADDING, self._spare * self._excess) * self._allowed_kbps
        return min(most_kbps, max(0.0, self._allowed_kbps - views_kbps))

    def _views_kbps(self) -> float:
        """The rate sent without padding of late."""
        newest_ns, newest_bytes = self._views_sent[-1]
        then_ns, then_bytes = next(s for s in self._views_sent if s[0] >= newest_ns - WINDOW_NS)
        if then_ns == newest_ns:
            return self._allowed_kbps
        return (newest_bytes - then_bytes) * 8e6 / (newest_ns - then_ns)

    # --- silence ----------------------------------------------------------------------------------

    def _is_silent(self, now_ns: int) -> bool:
        """True if nothing is reported of what was sent long enough ago."""
        long_ago_ns = now_ns - self._base_trip_ns - self._rate_ns
        if self._began_ns is None or self._reported_ns > long_ago_ns:
            return False
        newest_ns = self._deliveries.newest_sent_ns
        reported_bytes = next((sent for t_ns, sent in self._sent if t_ns >= newest_ns), math.inf)
        return self._sent_bytes_by(long_ago_ns) > reported_bytes

    def _decay(self, elapsed_ns: int) -> None:
        """Halve what is sent in each window, and what is remembered of the link in each second."""
        self._silent = True
        self._deliveries.forget_arrivals()
        self._kbps = self._bounded(self._kbps * 0.5 ** (elapsed_ns / NS_PER_S))
        self._allowed_kbps = self._bounded(self._allowed_kbps * 0.5 ** (elapsed_ns / WINDOW_NS))

    # --- the estimate -----------------------------------------------------------------------------

    def _hear(self, now_ns: int, elapsed_ns: int) -> None:
        """Take in the newest arrivals, unless they were only held up by an outage."""
        self._reported_ns = now_ns
        newest_ns = self._deliveries.newest_sent_ns
        if self._silent:
            self._silent = False
            self._resumed_ns = now_ns
            self._delay.resume()
            self._limited = False
            self._probe(now_ns, _FIRST_EXCESS)
            self._allowed_kbps = self._kbps
        if newest_ns <= self._resumed_ns:
            self._phase_ns = now_ns
            return
        if self._began_ns is None:
            self._began_ns = now_ns
            self._base_trip_ns = _clamped(now_ns - newest_ns)
        self._judge(now_ns, elapsed_ns)

    def _judge(self, now_ns: int, elapsed_ns: int) -> None:
        """Correct the estimate, and decide what is sent meanwhile."""
        newest_ns = self._deliveries.newest_sent_ns
        self._window_ns = self._delay.window_ns
        arrived_kbps, sent_kbps = self._deliveries.rates_kbps(self._rate_ns)
        self._delay.step(now_ns, sent_kbps)
        queue_ns = self._delay.queue_ns
        longer_ns = _clamped(now_ns - newest_ns - queue_ns) - self._base_trip_ns
        self._base_trip_ns += (_TRIP_UP if longer_ns > 0 else _TRIP_DOWN) * longer_ns
        target_ns = max(self._delay.spread_ns, _LEAST_TARGET_NS)
        self._target_ns = min(target_ns, self._most_target_ns)
        lost = min(self._deliveries.loss(), _RADIO_LOSS)  # what the radio lost has passed the queue
        arrived_kbps /= 1.0 - lost
        if self._phase is _Phase.SHARE:
            self._share(now_ns, elapsed_ns, arrived_kbps)
            return
        if sent_kbps:
            self._measure(now_ns, elapsed_ns, queue_ns, arrived_kbps, sent_kbps)
        elif self._is_new(now_ns):
            return  # too little is known to probe
        self._turn(now_ns, queue_ns, sent_kbps)
        under_way_bytes = self._sent[-1][1] - self._sent_bytes_by(newest_ns)
        ahead_ns = under_way_bytes * 8e6 / self._kbps - (now_ns - newest_ns)
        wanted_ns = self._excess * self._target_ns if self._phase is _Phase.PROBE else 0.0
        more = (wanted_ns - max(0.0, queue_ns + ahead_ns)) / self._window_ns
        allowed_kbps = self._kbps * min(max(1.0 + more, _LEAST_SHARE), 2.0)
        if self._phase is _Phase.PROBE:  # what a doubling does is seen before the next
            growth = min(_MOST_GROWTH, 1.0 + _UNHEARD_NS / max(self._base_trip_ns, 1.0))
            allowed_kbps = min(allowed_kbps, max(_LEAST_GROWTH, growth) * self._probed_kbps)
        self._allowed_kbps = self._bounded(allowed_kbps)

    def _measure(
        self, now_ns: int, elapsed_ns: int, queue_ns: int, arrived_kbps: float, sent_kbps: float
    ) -> None:
        """Correct the estimate by what arrived, and by the rate at which that was sent."""
        slower = min(1.0, arrived_kbps / sent_kbps)
        queued = min(max(2.0 * queue_ns / (_SHOWS * self._target_ns) - 1.0, 0.0), 1.0)
        weight = queued * min(1.0, elapsed_ns / self._rate_ns)
        if slower < _DISPERSED and self._is_new(now_ns):
            self._kbps, self._excess = self._bounded(arrived_kbps), _EXCESS_OF_KNOWN
            self._probed_kbps = self._kbps
            return
        kbps = max(self._kbps, min(arrived_kbps, sent_kbps)) * slower**weight
        self._kbps = self._bounded(kbps + weight * max(0.0, arrived_kbps - kbps))

    def _turn(self, now_ns: int, queue_ns: int, sent_kbps: float) -> None:
        shows_ns = _SHOWS * self._target_ns
        span_ns = self._base_trip_ns + self._window_ns  # until what is sent has been judged
        self._most_sent_kbps = max(self._most_sent_kbps, sent_kbps)
        phase_ns = now_ns - self._phase_ns
        if self._phase is _Phase.PROBE:
            self._most_queue_ns = max(self._most_queue_ns, queue_ns)
            if queue_ns > shows_ns:
                self._drain(now_ns)
            elif phase_ns > span_ns:
                free = self._kbps > self._probed_kbps or self._most_queue_ns < shows_ns / 2
                if free:
                    used = sent_kbps >= _USED * self._kbps
                    self._probe(now_ns, 2.0 * self._excess if used else 1.0)
                else:
                    self._drain(now_ns)
            return
        if phase_ns > span_ns and queue_ns > shows_ns:
            self._follow_level()
        if phase_ns > 1.5 * span_ns and queue_ns < shows_ns / 2:
            self._limited = self._limited or self._kbps < _CARRIED * self._most_sent_kbps
            self._probe(now_ns, 1.0 if self._limited else max(1.0, self._excess / 2.0))
        elif phase_ns > _STUCK * span_ns:
            self._doubt(now_ns, 2.0 * shows_ns)

    def _probe(self, now_ns: int, excess: float = 1.0) -> None:
        self._phase, self._phase_ns = _Phase.PROBE, now_ns
        self._excess = min(excess, 1e3)
        self._most_queue_ns, self._probed_kbps = 0, self._kbps
        self._most_sent_kbps = 0.0

    def _drain(self, now_ns: int) -> None:
        self._phase, self._phase_ns, self._levels_ns = _Phase.DRAIN, now_ns, None

    def _is_new(self, now_ns: int) -> bool:
        """True while the estimate is the floors' sum rather than a measurement."""
        began_ns = now_ns if self._began_ns is None else self._began_ns
        return now_ns - began_ns < self._base_trip_ns + WINDOW_NS

    # --- other flows ------------------------------------------------------------------------------

    def _follow_level(self) -> None:
        level_ns = self._delay.level_ns
        least_ns, most_ns = self._levels_ns or (level_ns, level_ns)
        self._levels_ns = min(least_ns, level_ns), max(most_ns, level_ns)

    def _doubt(self, now_ns: int, moves_ns: float) -> None:
        """The queue stays although less was sent."""
        least_ns, most_ns = self._levels_ns or (0, 0)
        own_base_ns = self._delay.base_ns
        self._delay.rebase(self._delay.level_ns)
        self._probe(now_ns)
        if most_ns - least_ns > moves_ns:
            self._phase, self._own_base_ns, self._cut_ns = _Phase.SHARE, own_base_ns, now_ns
            self._levels_ns = None

    def _share(self, now_ns: int, elapsed_ns: int, arrived_kbps: float) -> None:
        """Two packets more in each round trip, less after loss, until the queue has gone."""
        trip_ns = self._base_trip_ns + self._delay.level_ns - self._own_base_ns
        lost = self._deliveries.loss(round(trip_ns))
        if lost > _RADIO_LOSS and now_ns - self._cut_ns > trip_ns:
            self._kbps, self._cut_ns = _CUT * self._kbps, now_ns
        else:
            self._kbps += _PACKETS * _PACKET_BITS * 1e6 / trip_ns * (elapsed_ns / trip_ns)
        self._kbps = self._allowed_kbps = self._bounded(min(self._kbps, 1.5 * arrived_kbps))
        self._follow_level()
        if self._delay.level_ns < self._own_base_ns + _SHOWS * self._target_ns:
            self._delay.rebase(self._own_base_ns)
            self._drain(now_ns)
        elif self._levels_ns and now_ns - self._phase_ns > _SHARED_NS:
            self._delay.rebase(self._levels_ns[0])  # is the other still there, or only the queue?
            self._drain(now_ns)

    # ----------------------------------------------------------------------------------------------

    @property
    def _rate_ns(self) -> int:
        """The time that rates are taken over: one burst more or less in it is a fourteenth."""
        return self._window_ns * 3 // 2

    def _bounded(self, kbps: float) -> float:
        return min(max(kbps, _LEAST_KBPS), self._max_kbps)

    def _sent_bytes_by(self, t_ns: float) -> float:
        """The bytes that had been sent by then, evenly between the steps."""
        for later, earlier in pairwise(reversed(self._sent)):
            if earlier[0] <= t_ns:
                passed = min(1.0, (t_ns - earlier[0]) / (later[0] - earlier[0]))
                return earlier[1] + passed * (later[1] - earlier[1])
        return self._sent[0][1]


def _clamped(trip_ns: float) -> float:
    return min(max(trip_ns, 0.0), 1.0 * NS_PER_S)

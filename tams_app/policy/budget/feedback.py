"""The budget from per-packet feedback of all views together."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

from tams_app.config import BudgetConfig
from tams_app.policy.budget.deliveries import Deliveries
from tams_app.policy.budget.queueing_delay import QueueingDelay
from tams_app.records import UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

_HISTORY_NS = NS_PER_S  # what was sent and allowed
_RATE_NS = 100 * NS_PER_MS  # three frame periods
_COMPLETE_NS = 300 * NS_PER_MS
_COMPLETE = 0.97
_USED = 0.7  # share of the allowance below which the views, not the link, limit what is sent

_DRAIN_NS = 250 * NS_PER_MS  # a queue of this length stops the views
_STUCK_NS = 1500 * NS_PER_MS  # a queue of our own would have gone by then
_INDEPENDENT_LOSS = 0.02  # radio links lose less without a queue
_HEAVY_LOSS = 0.1

_SILENCE_NS = 200 * NS_PER_MS  # four of the longest feedback intervals
_HALF_LIFE_NS = 100 * NS_PER_MS
_KNOCK_KBPS = 8.0  # 50 bytes at a time, so that the link's return is noticed

_PROBE_EVERY_NS = NS_PER_S
_PROBE_NS = 250 * NS_PER_MS
_PROBE_GAIN = 0.04  # 10 ms of queue after a probe of a link that has nothing free
_PROBE_WEIGHT = 0.35
_PROBE_QUEUE_NS = 4 * NS_PER_MS  # a probe without one says what was sent, not what is carried
_DOUBT_NS = 10 * NS_PER_S  # after which jitter may be what hides free capacity
_RAMP_AGAIN_NS = 400 * NS_PER_MS
_RAMP_AFTER_BACKLOG_NS = 200 * NS_PER_MS
_RAMP_STEADY_NS = 195 * NS_PER_MS  # until the first of it is reported
_RAMP_DOUBLES_NS = 150 * NS_PER_MS
_RAMP_QUEUE_NS = 10 * NS_PER_MS
_FULL_GAIN = 1.0  # as in TCP's slow start
_GAIN_WHEN_UNKNOWN = 0.15  # the link has just changed
_GAIN_WHEN_FREE = 0.06  # a probe came through

_SMALLEST_TRAIN_BYTES = 1000
_LONGEST_TRAIN_NS = 50 * NS_PER_MS
_MIN_FLIGHT_BYTES = 6_000.0  # a frame at the floors
_FIRST_LOOP_NS = 300 * NS_PER_MS
_LOOP_UP, _LOOP_DOWN = 0.2, 0.02  # near the longest: jitter is not to leave frames out


class _Mode(Enum):
    RAMP = "more than the estimate is sent, until a queue shows"
    CRUISE = "the estimate holds"
    PROBE = "slightly more than the estimate is sent for a moment"
    BACKLOG = "a queue is let run empty"
    SILENT = "nothing is heard of what was sent"


@dataclass(frozen=True, slots=True)
class _Sent:
    t_ns: int
    bytes: int  # since the start
    padding_bytes: int  # of these
    allowed_kbps: float  # from then on


class FeedbackBudget:
    """The rate at which the bottleneck delivers while slightly more than that is offered to it.

    A queue is the only proof that a link is full, so the estimate comes from short moments with
    one. While the views use what they are allowed, a probe adds padding once a second, for a
    quarter of a second, to 1.04 times the estimate, and what is delivered meanwhile corrects it,
    downwards only if it met a queue: else encoders that stay below their targets would lower it.
    Where all came through, a ramp goes on from there, doubling its excess until a queue shows. The
    safety factor leaves the room in which the queue of a probe runs empty.

    A queue beyond the delay target is a backlog: the rate of delivery is the capacity then, and
    the views get less than it until the queue has gone. A backlog that stays although less is
    sent is none of ours (a longer route, another flow that fills the queue): the delay of now
    becomes the base. Loss below 2 % counts as the radio's; more of it halves the delay that is
    tolerated, and above 10 % it lowers the estimate by itself. Views that send
    less than they may show nothing: only a rate of delivery above the estimate counts then.

    Without feedback the estimate halves every 100 ms, down to the floors; small padding keeps
    asking, and the answer starts a ramp as at the beginning.
    """

    def __init__(self, config: BudgetConfig, floors_kbps: float) -> None:
        """`floors_kbps` is what the views have together at least; the estimate begins there."""
        self._max_kbps = config.max_kbps
        self._safety_factor = config.safety_factor
        self._floor_kbps = min(config.max_kbps, floors_kbps / config.safety_factor)
        self._target_ns = config.delay_target_ms * NS_PER_MS
        self._delay = QueueingDelay()
        self._deliveries = Deliveries()
        self._kbps = self._allowed_kbps = self._floor_kbps
        self._mode = _Mode.RAMP
        self._since_ns: int | None = None  # of the mode
        self._gain = _FULL_GAIN  # of the ramp of now, as it began
        self._next_gain = _GAIN_WHEN_FREE
        self._next_probe_ns = 0
        self._ramped_ns = self._queued_ns = 0  # the last times of a ramp, of a queue,
        self._disturbed_ns = 0  # of a backlog or silence
        self._before_backlog_kbps = 0.0
        self._sent: deque[_Sent] = deque()
        self._pending = False  # a report was taken in that the estimate does not know yet
        self._stepped_ns = self._received_ns = 0
        self._news_ns: int | None = None  # when the newest packet was sent that it reports
        self._loop_ns: float = _FIRST_LOOP_NS  # from sending to the report of it, without a queue
        self._padding_kbps = 0.0
        self._padded_ns = 0
        self._padded_bytes = 0

    def observe(self, report: UplinkReport) -> None:
        if self._since_ns is None:
            self._since_ns = self._stepped_ns = self._received_ns = report.now_ns
        new = self._deliveries.take(report.arrivals)
        for packet in new:
            if packet.arrived_ns is not None:
                self._delay.add(packet.sent_ns, packet.arrived_ns)
        if new:
            self._received_ns = report.now_ns
            self._news_ns = self._deliveries.newest_sent_ns
        sent = _Sent(report.now_ns, report.sent_bytes, self._padded_bytes, self._allowed_kbps)
        if self._sent and self._sent[-1].t_ns == report.now_ns:
            self._sent.pop()
        self._sent.append(sent)
        while self._sent[0].t_ns < report.now_ns - _HISTORY_NS:
            self._sent.popleft()
        self._pending = True

    def capacity_kbps(self, now_ns: int) -> float:
        if self._pending:
            self._pending = False
            self._step(now_ns)
        return self._allowed_kbps

    def padding_bytes(self, now_ns: int) -> int:
        since_ns = now_ns - self._padded_ns
        train_ns = min(since_ns, _LONGEST_TRAIN_NS)
        padding = round(self._padding_kbps * train_ns / 8e6)
        if padding < _SMALLEST_TRAIN_BYTES and since_ns < _LONGEST_TRAIN_NS:
            return 0
        self._padded_ns = now_ns
        self._padded_bytes += padding
        return padding

    def flight_limit_bytes(self, now_ns: int) -> float:
        most_kbps = self._kbps + self._padding_kbps  # a ramp is not to stop the views
        return max(_MIN_FLIGHT_BYTES, most_kbps * (self._loop_ns + self._target_ns) / 8e6)

    # --- the estimate -----------------------------------------------------------------------------

    def _step(self, now_ns: int) -> None:
        elapsed_ns, self._stepped_ns = now_ns - self._stepped_ns, now_ns
        news_ns, self._news_ns = self._news_ns, None
        queue_ns = self._delay.queue_ns()
        if news_ns is not None:
            away_ns = min(now_ns - news_ns, NS_PER_S) - self._loop_ns
            if not queue_ns or away_ns < 0.0:
                self._loop_ns += (_LOOP_UP if away_ns > 0.0 else _LOOP_DOWN) * away_ns
            if self._mode is _Mode.SILENT:
                self._next_gain = _GAIN_WHEN_UNKNOWN
                self._ramp(now_ns, _FULL_GAIN)
            self._judge(now_ns, queue_ns)
        elif self._mode is _Mode.SILENT or self._silent(now_ns):
            self._enter(_Mode.SILENT, now_ns)
            self._deliveries.forget_arrivals()
            self._disturbed_ns = now_ns
            self._kbps *= 0.5 ** (elapsed_ns / _HALF_LIFE_NS)
        self._kbps = min(max(self._kbps, self._floor_kbps), self._max_kbps)
        self._allowed_kbps = self._kbps
        if self._mode is _Mode.BACKLOG:
            share = 1.0 - (queue_ns - self._target_ns / 2) / _DRAIN_NS
            self._allowed_kbps = max(self._floor_kbps, self._kbps * min(1.0, share))
        self._padding_kbps = self._padding_rate_kbps(now_ns)

    def _enter(self, mode: _Mode, now_ns: int) -> None:
        if mode is not self._mode:
            self._mode, self._since_ns = mode, now_ns

    def _in_mode_ns(self, now_ns: int) -> int:
        return now_ns - (self._since_ns if self._since_ns is not None else now_ns)

    def _silent(self, now_ns: int) -> bool:
        """True if something was sent long ago of which nothing was reported."""
        if now_ns - self._received_ns < _SILENCE_NS:
            return False
        reported_ns = self._deliveries.newest_sent_ns
        unreported = [s for s in self._sent if reported_ns <= s.t_ns <= now_ns - _SILENCE_NS]
        return bool(unreported) and unreported[-1].bytes > unreported[0].bytes

    def _judge(self, now_ns: int, queue_ns: float) -> None:
        """Change the estimate by the newest arrivals, in the present mode."""
        begun_anew = self._mode is _Mode.RAMP and self._gain == _FULL_GAIN
        if begun_anew and self._deliveries.newest_sent_ns <= (self._since_ns or 0):
            return  # what an outage has held up says nothing of the link as it is now
        loss = self._deliveries.loss()
        rate_kbps = self._rate_kbps(_RATE_NS)
        lossy = loss > _INDEPENDENT_LOSS
        unexplained = loss > _HEAVY_LOSS and now_ns > self._disturbed_ns + NS_PER_S
        if queue_ns > _RAMP_QUEUE_NS:
            self._queued_ns = now_ns
        if self._mode is _Mode.BACKLOG:
            self._drain(now_ns, queue_ns, rate_kbps)
        elif queue_ns > (self._target_ns / 2 if lossy else self._target_ns):
            self._back_up(now_ns)
            self._drain(now_ns, queue_ns, rate_kbps)
        elif self._mode is _Mode.RAMP:
            self._follow_ramp(now_ns, unexplained or queue_ns > _RAMP_QUEUE_NS, rate_kbps)
        elif self._mode is _Mode.PROBE:
            self._follow_probe(now_ns, queue_ns)
        elif now_ns >= self._next_probe_ns and self._used():
            if unexplained:
                self._kbps *= 1.0 - loss / 2
                self._next_probe_ns = now_ns + _PROBE_EVERY_NS
            else:
                self._search(now_ns)

    def _rate_kbps(self, window_ns: int) -> float:
        """The rate at the bottleneck: what is lost by the radio has passed it."""
        lost_by_radio = min(self._deliveries.loss(), _INDEPENDENT_LOSS)
        return self._deliveries.rate_kbps(window_ns) / (1.0 - lost_by_radio)

    def _used(self) -> bool:
        """True if the views used what they were allowed in the last second."""
        allowed = sum(a.allowed_kbps * (b.t_ns - a.t_ns) for a, b in pairwise(self._sent))
        sent = (self._sent[-1].bytes - self._sent[0].bytes) * 8e6
        return sent >= _USED * self._safety_factor * allowed

    def _complete(self, now_ns: int) -> bool:
        """True if the fate of what was sent of late is known; else feedback was lost."""
        reported = [s for s in self._sent if s.t_ns <= self._deliveries.newest_sent_ns]
        if not reported:
            return False
        first = next(s for s in reported if s.t_ns >= reported[-1].t_ns - _COMPLETE_NS)
        known = self._deliveries.reported_bytes(first.t_ns, reported[-1].t_ns)
        return known >= _COMPLETE * (reported[-1].bytes - first.bytes)

    # --- a backlog --------------------------------------------------------------------------------

    def _back_up(self, now_ns: int) -> None:
        """A queue has shown: of a ramp's own making, or because the link has changed."""
        if self._mode is _Mode.RAMP:
            self._next_gain = max(_PROBE_GAIN, self._next_gain / 2)
        elif now_ns > self._ramped_ns + NS_PER_S // 2:
            self._next_gain = _GAIN_WHEN_UNKNOWN
        self._before_backlog_kbps = self._kbps
        self._enter(_Mode.BACKLOG, now_ns)

    def _drain(self, now_ns: int, queue_ns: float, rate_kbps: float) -> None:
        self._disturbed_ns = now_ns
        if queue_ns < self._target_ns / 2:
            self._enter(_Mode.CRUISE, now_ns)
            self._next_probe_ns = now_ns + _RAMP_AFTER_BACKLOG_NS
        elif self._in_mode_ns(now_ns) > _STUCK_NS:
            self._delay.forget()
            self._kbps = self._before_backlog_kbps
        elif rate_kbps > self._kbps or (self._used() and self._complete(now_ns)):
            self._kbps = rate_kbps

    # --- looking for more -------------------------------------------------------------------------

    def _search(self, now_ns: int) -> None:
        if now_ns > self._queued_ns + _DOUBT_NS:
            self._queued_ns = now_ns
            self._next_gain = max(self._next_gain, _GAIN_WHEN_FREE)
        if self._next_gain > _PROBE_GAIN:
            self._ramp(now_ns, self._next_gain)
        else:
            self._enter(_Mode.PROBE, now_ns)

    def _ramp(self, now_ns: int, gain: float) -> None:
        self._gain = gain
        self._enter(_Mode.RAMP, now_ns)

    def _follow_ramp(self, now_ns: int, ended: bool, rate_kbps: float) -> None:
        self._ramped_ns = now_ns
        if not ended and self._kbps < self._max_kbps:
            self._kbps = max(self._kbps, rate_kbps)
            return
        if ended:  # rare frames leave gaps, which a short window may take for a slow link
            self._kbps = min(self._kbps, max(rate_kbps, self._rate_kbps(_PROBE_NS)))
        if self._gain == _FULL_GAIN and self._kbps < 2 * self._floor_kbps:
            self._next_gain = _GAIN_WHEN_UNKNOWN  # so soon, jitter may have ended it
        else:
            self._next_gain = max(_PROBE_GAIN, self._next_gain / 2)
        steady = self._next_gain == _PROBE_GAIN
        self._next_probe_ns = now_ns + (_PROBE_EVERY_NS if steady else _RAMP_AGAIN_NS)
        self._enter(_Mode.CRUISE, now_ns)

    def _follow_probe(self, now_ns: int, queue_ns: float) -> None:
        assert self._since_ns is not None
        end_ns = self._since_ns + _PROBE_NS
        if self._deliveries.newest_sent_ns <= end_ns:
            return
        lost_by_radio = min(self._deliveries.loss(), _INDEPENDENT_LOSS)
        rate_kbps = self._deliveries.rate_of_kbps(self._since_ns, end_ns) / (1.0 - lost_by_radio)
        self._next_probe_ns = now_ns + _PROBE_EVERY_NS
        complete = self._complete(now_ns)
        self._enter(_Mode.CRUISE, now_ns)
        queued = queue_ns > _PROBE_QUEUE_NS
        if rate_kbps > (1.0 + (0.7 if queued else 0.4) * _PROBE_GAIN) * self._kbps:
            self._kbps *= 1.0 + _PROBE_GAIN
            self._next_gain = _GAIN_WHEN_FREE
            self._ramp(now_ns, self._next_gain)
        elif complete and self._used() and queued:
            self._kbps += _PROBE_WEIGHT * (rate_kbps - self._kbps)

    def _padding_rate_kbps(self, now_ns: int) -> float:
        """The rate that a probe or a ramp lacks, beside what the views send."""
        in_mode_ns = self._in_mode_ns(now_ns)
        if self._mode is _Mode.RAMP:
            doublings = max(0.0, in_mode_ns - _RAMP_STEADY_NS) / _RAMP_DOUBLES_NS
            gain = min(_FULL_GAIN, self._gain * math.exp2(doublings))
        elif self._mode is _Mode.PROBE and in_mode_ns < _PROBE_NS:
            gain = _PROBE_GAIN
        else:
            return _KNOCK_KBPS if self._mode is _Mode.SILENT else 0.0
        views_kbps = max(self._views_kbps(now_ns), self._safety_factor * self._allowed_kbps)
        return max(0.0, min(self._kbps * (1.0 + gain), self._max_kbps) - views_kbps)

    def _views_kbps(self, now_ns: int) -> float:
        """The rate sent without padding in the last 100 ms."""
        then, now = next(s for s in self._sent if s.t_ns >= now_ns - _RATE_NS), self._sent[-1]
        sent = now.bytes - then.bytes - (now.padding_bytes - then.padding_bytes)
        return sent * 8e6 / (now.t_ns - then.t_ns) if now.t_ns > then.t_ns else 0.0

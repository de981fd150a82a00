"""The queueing delay of an uplink, from one-way delays on two unsynchronised clocks."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tams_app.policy.budget.deliveries import CLOCK_JUMP_NS
from tams_app.units import NS_PER_MS, NS_PER_S

WINDOW_NS, _LONGEST_WINDOW_NS = 100 * NS_PER_MS, NS_PER_S  # at least, at most, nine bursts' time
_BURSTS = 9  # frames of three views in a tenth of a second: enough for quartiles
_LEVEL_NS = 60 * NS_PER_MS  # two frame periods
_JITTER_NS = 8 * NS_PER_MS  # a spread from which levels need longer to be comparable
_LONGEST = 6  # times _LEVEL_NS
_LOW = 0.2  # a low quantile moves with a queue that stands, and little with jitter
_BASE_NS = 10 * NS_PER_S  # 100 ppm of drift are 1 ms in it, and some of it was without a queue
_ALIKE = 0.5  # share of the present rate from which a past level is comparable
_ENOUGH = 4  # of such levels
_GAP_NS = NS_PER_MS  # between the packets of two bursts; those of one wait for each other
_LONGEST_BURST_NS = 5 * NS_PER_MS  # less than a third of a frame period
_KEPT = 128  # bursts: more than come in the longest level


@dataclass(frozen=True, slots=True)
class _Level:
    """The observation of one step."""

    t_ns: int
    level_ns: int
    spread_ns: int
    sent_kbps: float


class QueueingDelay:
    """A low quantile of delays now, above the same quantile of what it has been for 10 s.

    Only the first packet of each burst counts: those behind it wait for it. Jitter delays single
    packets, and where order is kept those behind them, too, so no single delay says anything. How
    far the delays of a few bursts lie apart says how much jitter there is; the more, the longer
    the time that a quantile is taken of. Where order is kept, packets that follow closely hold
    each other up and the least delays no longer occur: levels at less than half the present rate
    are not compared with. A queue that stands moves all delays. The clocks' offset is in both
    quantiles alike.
    """

    def __init__(self) -> None:
        self._bursts: deque[tuple[int, int]] = deque(maxlen=_KEPT)  # (sent, delay) of the first
        self._history: deque[_Level] = deque()
        self._sent_ns = -_GAP_NS - 1
        self._arrived_ns: int | None = None
        self.level_ns = self.base_ns = self.spread_ns = 0

    def add(self, sent_ns: int, arrived_ns: int) -> None:
        """Take in a packet, in the order of sending."""
        if self._arrived_ns is None or abs(arrived_ns - self._arrived_ns) > CLOCK_JUMP_NS:
            self._bursts.clear()
            self._history.clear()
        self._arrived_ns = arrived_ns
        if (
            not self._bursts
            or sent_ns > self._sent_ns + _GAP_NS
            or sent_ns > self._bursts[-1][0] + _LONGEST_BURST_NS
        ):
            self._bursts.append((sent_ns, arrived_ns - sent_ns))
        self._sent_ns = max(sent_ns, self._sent_ns)

    def step(self, now_ns: int, sent_kbps: float) -> None:
        """Compare the packets received.

        Args:
            now_ns: the time; it never decreases.
            sent_kbps: the rate at which the newest packets were sent.
        """
        if not self._bursts:
            return
        delays = sorted(delay for _, delay in list(self._bursts)[-_BURSTS:])
        spread_ns = _quantile(delays, 0.75) - _quantile(delays, 0.25)
        self.level_ns = self._level_ns()
        self._history.append(_Level(now_ns, self.level_ns, spread_ns, sent_kbps))
        while self._history[0].t_ns < now_ns - _BASE_NS:
            self._history.popleft()
        alike = [past for past in self._history if past.sent_kbps >= _ALIKE * sent_kbps]
        compared: Iterable[_Level] = alike if len(alike) >= _ENOUGH else self._history
        self.base_ns = _quantile(sorted(past.level_ns for past in compared), _LOW)
        self.spread_ns = _quantile(sorted(past.spread_ns for past in self._history), 0.5)

    def _level_ns(self) -> int:
        longer = min(max(1.0, self.spread_ns / _JITTER_NS), _LONGEST)
        since_ns = self._bursts[-1][0] - longer * _LEVEL_NS
        delays = [delay for sent_ns, delay in self._bursts if sent_ns > since_ns]
        if len(delays) < _BURSTS:
            delays = [delay for _, delay in list(self._bursts)[-_BURSTS:]]
        return _quantile(sorted(delays), _LOW)

    @property
    def window_ns(self) -> int:
        """The time that nine bursts took [ns]: a tenth of a second, more where frames are rare."""
        if len(self._bursts) <= _BURSTS:
            return WINDOW_NS
        took_ns = self._bursts[-1][0] - self._bursts[-1 - _BURSTS][0]
        return min(max(took_ns, WINDOW_NS), _LONGEST_WINDOW_NS)

    @property
    def queue_ns(self) -> int:
        """The time that packets wait at the bottleneck, beyond jitter [ns]."""
        return max(0, self.level_ns - self.base_ns)

    def resume(self) -> None:
        """Begin levels anew after a gap; the base stays."""
        self._bursts.clear()

    def rebase(self, base_ns: int) -> None:
        """From now on delays count from `base_ns`."""
        if self._history:
            newest = self._history[-1]
            self._history.clear()
            self._history.append(_Level(newest.t_ns, base_ns, newest.spread_ns, newest.sent_kbps))
            self.base_ns, self.spread_ns = base_ns, newest.spread_ns


def _quantile(ordered: Sequence[int], share: float) -> int:
    return ordered[int(len(ordered) * share)]

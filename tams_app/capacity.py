"""Capacities of a bottleneck over time: constant, from a trace, or without limit.

Times are absolute nanoseconds of the session's clock, rates kbit/s of IP datagram bytes, amounts
bits. A packet takes `finish_ns(start, bits) - start` to leave, however the rate changes meanwhile.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Protocol

SMALLEST_KBPS = 1.0  # below it no packet ends within a trial, and at last the arithmetic fails
LARGEST_KBPS = 1e9
_BITS_PER_NS_PER_KBPS = 1e-6


class Capacity(Protocol):
    """The capacity of a bottleneck over time."""

    def rate_kbps(self, t_ns: int) -> float:
        """The rate at one instant.

        Args:
            t_ns: the instant [ns].

        Returns:
            kbit/s of IP datagram bytes; infinite without a bottleneck.
        """

    def finish_ns(self, start_ns: int, bits: int) -> int:
        """The end of a packet's way through the bottleneck.

        Args:
            start_ns: when it begins to leave [ns].
            bits: its size.

        Returns:
            The first instant [ns] at which all of it has passed.
        """

    def mean_kbps(self, start_ns: int, end_ns: int) -> float:
        """The mean rate between two instants.

        Args:
            start_ns: the first [ns].
            end_ns: the second [ns].

        Returns:
            kbit/s of IP datagram bytes; over no time, the rate there.
        """


def finite(kbps: float) -> float | None:
    """A capacity [kbit/s]; None where it is without limit."""
    return kbps if math.isfinite(kbps) else None


class UnlimitedCapacity:
    """No bottleneck."""

    def rate_kbps(self, t_ns: int) -> float:
        return math.inf

    def finish_ns(self, start_ns: int, bits: int) -> int:
        return start_ns

    def mean_kbps(self, start_ns: int, end_ns: int) -> float:
        return math.inf


class ConstantCapacity:
    """The same rate [kbit/s] at all times; ValueError below `SMALLEST_KBPS` or not finite."""

    def __init__(self, kbps: float) -> None:
        if not SMALLEST_KBPS <= kbps < math.inf:
            raise ValueError("a constant capacity must be finite and at least 1 kbit/s")
        self._kbps = kbps

    def rate_kbps(self, t_ns: int) -> float:
        return self._kbps

    def finish_ns(self, start_ns: int, bits: int) -> int:
        return start_ns + math.ceil(bits / (self._kbps * _BITS_PER_NS_PER_KBPS))

    def mean_kbps(self, start_ns: int, end_ns: int) -> float:
        return self._kbps


@dataclass(frozen=True, slots=True)
class RateTrace:
    """Rates that hold from one time to the next; the last one until `period_ns`, then again.

    `starts_ns` ascend strictly from 0 to below `period_ns`; `kbps` has the same length, none is
    negative, one at least is positive. ValueError otherwise.
    """

    starts_ns: tuple[int, ...]
    kbps: tuple[float, ...]
    period_ns: int

    def __post_init__(self) -> None:
        if not self.starts_ns or len(self.starts_ns) != len(self.kbps):
            raise ValueError("a trace needs as many rates as times, and one at least")
        times = (*self.starts_ns, self.period_ns)
        if times[0] != 0 or any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("the times of a trace must ascend from 0")
        if not all(0 <= rate < math.inf for rate in self.kbps):
            raise ValueError("the rates of a trace must be finite and not negative")
        if not any(self.kbps):
            raise ValueError("the trace carries nothing: every rate is 0")


class TraceCapacity:
    """A trace that begins at `epoch_ns` and repeats for ever; before it, its first rate holds.

    A window that reaches back before the epoch thus knows nothing of the trace's end.
    """

    def __init__(self, trace: RateTrace, epoch_ns: int) -> None:
        self._trace = trace
        self._epoch_ns = epoch_ns
        self._per_ns = [rate * _BITS_PER_NS_PER_KBPS for rate in trace.kbps]
        ends_ns = (*trace.starts_ns[1:], trace.period_ns)
        segments = zip(trace.starts_ns, ends_ns, self._per_ns, strict=True)
        self._ends_bits = list(accumulate((end - start) * rate for start, end, rate in segments))
        self._starts_bits = [0.0, *self._ends_bits[:-1]]
        self._period_bits = self._ends_bits[-1]

    def rate_kbps(self, t_ns: int) -> float:
        return self._trace.kbps[self._segment(max(0, t_ns - self._epoch_ns))]

    def finish_ns(self, start_ns: int, bits: int) -> int:
        target_bits = self._bits_until(start_ns - self._epoch_ns) + bits
        if bits == 0:
            return start_ns
        # rounding of the running sum must not let a packet leave before it began
        return max(start_ns, self._epoch_ns + self._time_of(target_bits))

    def mean_kbps(self, start_ns: int, end_ns: int) -> float:
        if end_ns <= start_ns:
            return self.rate_kbps(end_ns)
        start_bits, end_bits = (self._bits_until(t - self._epoch_ns) for t in (start_ns, end_ns))
        return (end_bits - start_bits) / _BITS_PER_NS_PER_KBPS / (end_ns - start_ns)

    def _segment(self, t_ns: int) -> int:
        return bisect_right(self._trace.starts_ns, t_ns % self._trace.period_ns) - 1

    def _bits_until(self, t_ns: int) -> float:
        """Bits from the epoch to `t_ns` after it; negative before the epoch."""
        if t_ns <= 0:
            return t_ns * self._per_ns[0]
        loops, within_ns = divmod(t_ns, self._trace.period_ns)
        index = self._segment(within_ns)
        in_segment = (within_ns - self._trace.starts_ns[index]) * self._per_ns[index]
        return loops * self._period_bits + self._starts_bits[index] + in_segment

    def _time_of(self, bits: float) -> int:
        """The first time after the epoch at which `bits` have passed since it [ns]."""
        if bits <= 0:
            return math.ceil(bits / self._per_ns[0]) if self._per_ns[0] else 0
        loops = math.ceil(bits / self._period_bits) - 1
        rest = min(bits - loops * self._period_bits, self._period_bits)
        if rest <= 0:  # the quotient was rounded up: they had passed when the round before ended
            loops, rest = loops - 1, self._period_bits
        index = bisect_left(self._ends_bits, rest)  # never a segment of rate 0: those add nothing
        in_segment_ns = math.ceil((rest - self._starts_bits[index]) / self._per_ns[index])
        return loops * self._trace.period_ns + self._trace.starts_ns[index] + in_segment_ns

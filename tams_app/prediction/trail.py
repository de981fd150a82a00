"""A vector over time, of the last seconds."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

from tams_app.records import Vector


class Trail:
    """Samples in order of time, linear between them."""

    def __init__(self, kept_ns: int) -> None:
        """`kept_ns`: what is older than the newest by more may be forgotten."""
        self._kept_ns = kept_ns
        self._samples: deque[tuple[int, Vector]] = deque()

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def newest(self) -> tuple[int, Vector]:
        """The last sample; IndexError where there is none."""
        return self._samples[-1]

    def add(self, t_ns: int, value: Vector) -> None:
        """One more; one that is not newer than the last is left out."""
        if self._samples and t_ns <= self._samples[-1][0]:
            return
        self._samples.append((t_ns, value))
        while len(self._samples) > 1 and self._samples[1][0] < t_ns - self._kept_ns:
            self._samples.popleft()

    def covers(self, t_ns: int, beyond_ns: int) -> bool:
        """Whether `t_ns` is within the samples, or after the newest by at most `beyond_ns`."""
        if not self._samples:
            return False
        return self._samples[0][0] <= t_ns <= self._samples[-1][0] + beyond_ns

    def at(self, t_ns: int, ahead_ns: int = 0) -> Vector:
        """The value then; before the oldest and after the newest sample, theirs.

        `ahead_ns`: the newest two are continued for so long after the newest. IndexError where
        there is none.
        """
        samples = self._samples
        after = bisect_right(samples, t_ns, key=_time)
        if after == 0:
            return samples[0][1]
        if after == len(samples):
            if len(samples) == 1 or not ahead_ns:
                return samples[-1][1]
            after, t_ns = after - 1, min(t_ns, samples[-1][0] + ahead_ns)
        before_ns, before = samples[after - 1]
        after_ns, later = samples[after]
        return before + (later - before) * ((t_ns - before_ns) / (after_ns - before_ns))


def _time(sample: tuple[int, Vector]) -> int:
    return sample[0]

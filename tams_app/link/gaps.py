"""Gaps between the samples of the hand: how many hold the arm, and what to set for them.

One rule for `doctor --link`, which measures a network, and for a session that was held: the arm
holds (*link gap*) where no sample comes for `link.lost_after_ms`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from tams_app.units import NS_PER_MS, NS_PER_S

MOST_A_MINUTE = 3.0
_MARGIN = 1.2  # a gap that was measured is not the longest there will be
_LARGEST_MS = 1000  # of `link.lost_after_ms`
_WINDOW_NS = 60 * NS_PER_S


def too_many(gaps_ms: Sequence[float], seconds: float, lost_after_ms: float) -> float:
    """How many gaps a minute hold the arm, if that is more than three; else 0."""
    a_minute = sum(gap_ms > lost_after_ms for gap_ms in gaps_ms) * 60.0 / seconds
    return a_minute if a_minute > MOST_A_MINUTE else 0.0


def lost_after_for(
    gaps_ms: Sequence[float], seconds: float, lost_after_ms: float, most_ms: float = _LARGEST_MS
) -> float | None:
    """`link.lost_after_ms` with which three of these gaps a minute would hold the arm, at most.

    What it is where it does; None where it may not be as large as that. `most_ms`: its largest.
    """
    if not too_many(gaps_ms, seconds, lost_after_ms):
        return lost_after_ms
    left = sorted(gaps_ms, reverse=True)[int(MOST_A_MINUTE * seconds / 60.0)]
    wanted_ms = math.ceil(left * _MARGIN / 10) * 10
    return float(wanted_ms) if wanted_ms <= most_ms else None


def advice(
    gaps_ms: Sequence[float], seconds: float, lost_after_ms: float, most_ms: float = _LARGEST_MS
) -> str:
    """The longest gaps, how many hold the arm, and what to do: a sentence of 220 bytes at most."""
    longest = ", ".join(f"{gap_ms:.0f}" for gap_ms in sorted(gaps_ms, reverse=True)[:3])
    found = f"the longest gaps are {longest} ms"
    a_minute = too_many(gaps_ms, seconds, lost_after_ms)
    if not a_minute:
        return f"{found}; at most {MOST_A_MINUTE:g} a minute exceed {lost_after_ms:g} ms"
    wanted_ms = lost_after_for(gaps_ms, seconds, lost_after_ms, most_ms)
    setting = f"set link.lost_after_ms to {wanted_ms:g}, " if wanted_ms else "no setting helps; "
    return (
        f"{found}; {a_minute:.0f} a minute exceed link.lost_after_ms ({lost_after_ms:g} ms) and "
        f"hold the arm: {setting}switch Wi-Fi power saving off (iw dev NAME set power_save off), "
        "or use a cable"
    )


class GapWatch:
    """The gaps of a session in the last minute; says once what to do if too many hold the arm."""

    def __init__(self, lost_after_ms: float, fault_after_ms: float) -> None:
        self._lost_after_ms, self._fault_after_ms = lost_after_ms, fault_after_ms
        self._gaps: deque[tuple[int, float]] = deque()  # (when it ended, how long [ms])
        self._received_ns: int | None = None
        self._advised = False

    def forget(self) -> None:
        """Another operator comes: the time without any was no gap."""
        self._received_ns = None

    def step(self, now_ns: int, armed: bool) -> str:
        """A sample that counts was received; the advice, once, "" otherwise."""
        before_ns, self._received_ns = self._received_ns, now_ns
        gap_ms = 0.0 if before_ns is None else (now_ns - before_ns) / NS_PER_MS
        if not armed or not self._lost_after_ms < gap_ms < self._fault_after_ms:
            return ""
        self._gaps.append((now_ns, gap_ms))
        while self._gaps[0][0] <= now_ns - _WINDOW_NS:
            self._gaps.popleft()
        gaps_ms, seconds = [one for _, one in self._gaps], _WINDOW_NS / NS_PER_S
        if self._advised or not too_many(gaps_ms, seconds, self._lost_after_ms):
            return ""
        self._advised = True
        below_fault_ms = min(_LARGEST_MS, self._fault_after_ms - 1)
        return advice(gaps_ms, seconds, self._lost_after_ms, below_fault_ms)

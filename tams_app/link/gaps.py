"""Gaps between samples of the hand: how many hold the arm, and what to set for them.

The arm holds where no sample comes for `link.lost_after_ms` (*link gap*), and after three breaks
within a second, which may be shorter (*link gaps*): no setting permits those.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from tams_app.config import LinkConfig
from tams_app.units import NS_PER_MS, NS_PER_S

MOST_A_MINUTE = 3.0
_MARGIN = 1.2  # a gap that was measured is not the longest there will be
_LARGEST_MS = 1000  # of `link.lost_after_ms`
_WINDOW_NS = 60 * NS_PER_S
_BREAKS, _BREAKS_WITHIN_NS = 3, NS_PER_S


class Breaks:
    """After three breaks within a second the arm holds (*link gaps*) until that second is over."""

    def __init__(self) -> None:
        self._ended_ns: deque[int] = deque(maxlen=_BREAKS)

    def add(self, now_ns: int) -> bool:
        """One has ended; True if they are too many now."""
        self._ended_ns.append(now_ns)
        return self.too_many(now_ns)

    def too_many(self, now_ns: int) -> bool:
        """True while the arm holds."""
        ended_ns = self._ended_ns
        return len(ended_ns) == _BREAKS and now_ns - ended_ns[0] <= _BREAKS_WITHIN_NS


def lost_after_for(
    gaps_ms: Sequence[float], seconds: float, link: LinkConfig, too_often: int = 0
) -> float | None:
    """`link.lost_after_ms` with which three of these gaps a minute would hold the arm, at most.

    What it is where it does; None where no value does. `too_often`: how many `Breaks` made too
    many, or would with a larger value, which does not help where they are half as many.
    """
    at_most = int(MOST_A_MINUTE * seconds / 60.0)
    longer = sum(gap_ms > link.lost_after_ms for gap_ms in gaps_ms)
    if too_often and max(longer, too_often) > at_most and 2 * too_often >= longer:
        return None
    if longer <= at_most:
        return link.lost_after_ms
    wanted_ms = math.ceil(sorted(gaps_ms, reverse=True)[at_most] * _MARGIN / 10) * 10
    return float(wanted_ms) if wanted_ms <= min(_LARGEST_MS, link.fault_after_ms - 1) else None


def advice(gaps_ms: Sequence[float], seconds: float, link: LinkConfig, too_often: int = 0) -> str:
    """The longest gaps, how many hold the arm, and what to do: a sentence of 220 bytes at most."""
    longest = ", ".join(f"{gap_ms:.0f}" for gap_ms in sorted(gaps_ms, reverse=True)[:3])
    found, limit_ms = f"the longest gaps are {longest} ms", link.lost_after_ms
    wanted_ms = lost_after_for(gaps_ms, seconds, link, too_often)
    if wanted_ms == limit_ms:
        return f"{found}; at most {MOST_A_MINUTE:g} a minute exceed {limit_ms:g} ms"
    count = sum(gap_ms > limit_ms for gap_ms in gaps_ms)
    hold = f"exceed link.lost_after_ms ({limit_ms:g} ms) and hold the arm"
    if too_often and wanted_ms is None:
        count, hold = too_often, "are the third within a second and hold the arm (link gaps)"
    setting = f"set link.lost_after_ms to {wanted_ms:g}, " if wanted_ms else "no setting helps; "
    return (
        f"{found}; {count * 60.0 / seconds:.0f} a minute {hold}: {setting}"
        "switch Wi-Fi power saving off (iw dev NAME set power_save off), or use a cable"
    )


class GapWatch:
    """The gaps of a session's last minute; advises once what to do if too many hold the arm."""

    def __init__(self, link: LinkConfig) -> None:
        self._link = link
        self._gaps: deque[tuple[int, float, int]] = deque()  # (its end, how long [ms], too often)
        self._received_ns: int | None = None
        self._breaks = Breaks()  # as which the gaps count with a larger `lost_after_ms`
        self._too_often = 0
        self._advised = False

    def forget(self) -> None:
        """Another operator comes: the time without any was no gap."""
        self._received_ns = None

    def step(self, now_ns: int, armed: bool, too_often: int) -> str:
        """A sample that counts was received, and `too_often` as many breaks; the advice, once."""
        before_ns, self._received_ns = self._received_ns, now_ns
        gap_ms = 0.0 if before_ns is None else (now_ns - before_ns) / NS_PER_MS
        more, self._too_often = too_often - self._too_often, too_often
        if is_gap := self._link.lost_after_ms < gap_ms < self._link.fault_after_ms:
            more += self._breaks.add(now_ns)
        if not armed or not (is_gap or more):
            return ""
        self._gaps.append((now_ns, gap_ms, more))
        while self._gaps[0][0] <= now_ns - _WINDOW_NS:
            self._gaps.popleft()
        gaps_ms = [one for _, one, _ in self._gaps]
        found = gaps_ms, _WINDOW_NS / NS_PER_S, self._link, sum(one for *_, one in self._gaps)
        if self._advised or lost_after_for(*found) == self._link.lost_after_ms:
            return ""
        self._advised = True
        return advice(*found)

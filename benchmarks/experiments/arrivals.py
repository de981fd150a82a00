"""Fate of the media packets on a link: how many are lost, and when each view's first arrives.

The jitter buffers' timeouts count from the first arrival: two kinds of run that disagree about it
disagree about every repair that comes late.
"""

from __future__ import annotations

from typing import Any

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS
from tams_app.video.core.link import Link

_NS_PER_US = NS_PER_MS // 1000


class Arrivals:
    """Counts from the packets' records, which come in the order of time."""

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._lost = 0
        self._first_ns: dict[str, int] = {}

    def note(self, record: PacketRecord) -> None:
        """A packet has entered the link."""
        if record.kind is not PacketKind.MEDIA:
            return
        if record.fate is PacketFate.DELIVERED:
            self._first_ns.setdefault(record.view, record.delivered_ns)
        else:
            self._lost += 1

    def counts(self) -> dict[str, int]:
        """`first_arrivals_us` is the sum over the views, each counted from the run's start."""
        after_ns = sum(first_ns - self._start_ns for first_ns in self._first_ns.values())
        return {"first_arrivals_us": after_ns // _NS_PER_US, "packets_lost": self._lost}


class NotingLink(Link):
    """A link that tells `arrivals` of every packet."""

    def __init__(self, arrivals: Arrivals, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._arrivals = arrivals

    def offer(self, *arguments: Any, **others: Any) -> PacketRecord:
        record = super().offer(*arguments, **others)
        self._arrivals.note(record)
        return record

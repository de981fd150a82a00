"""What each second amounts to, for plots: `/rates`."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tams_app.capacity import finite
from tams_app.recording.topics import FrameCaptured, FrameShown, PacketBatch
from tams_app.records import (
    Allocation,
    FrameQuality,
    LinkCapacity,
    PacketFate,
    PacketKind,
    PolicyInputs,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.told_packets import ToldPackets

PERIOD_NS = NS_PER_S
_UNDER_WAY = 300  # captures of a view that may still be shown


@dataclass(frozen=True, slots=True)
class ViewRates:
    """One view in one second."""

    view: str
    target_kbps: float | None
    sent_kbps: float | None
    loss: float | None
    captured_fps: float
    shown_fps: float
    latency_ms: float | None
    live_ssim: float | None
    received_ssim: float | None


@dataclass(frozen=True, slots=True)
class Rates:
    """All views in one second; derived from the other records, for viewers alone."""

    t_ns: int  # its end
    target_kbps: float | None
    sent_kbps: float | None
    budget_kbps: float | None
    capacity_kbps: float | None  # of the emulated network
    estimate_kbps: float | None  # of the capacity, as the budget believes
    queue_ms: float | None
    loss: float | None
    views: tuple[ViewRates, ...]


@dataclass(slots=True)
class _Second:
    """What was counted of one view."""

    sent_bytes: int = 0  # padding left out: no target pays for it
    padding_bytes: int = 0
    packets: int = 0
    lost: int = 0
    captured: int = 0
    shown: int = 0
    latency_ms: list[float] = field(default_factory=list)
    live: list[float] = field(default_factory=list)
    received: list[float] = field(default_factory=list)


class RatesMeter:
    """Counts what is recorded; `take` gives a record once a second.

    A packet counts when its fate is recorded, a score when it is. Where no network is emulated,
    packets are known by what receivers tell, padding among them.
    """

    def __init__(self, views: tuple[str, ...], started_ns: int) -> None:
        self._views = views
        self._begun_ns = started_ns
        self._seconds = {view: _Second() for view in views}
        self._queue_ns: int | None = None
        self._told: ToldPackets | None = ToldPackets()  # None: the fates of all are known
        self._allocation: Allocation | None = None
        self._capacity_kbps: float | None = None
        self._captures: dict[str, deque[tuple[int, int]]] = {
            view: deque(maxlen=_UNDER_WAY) for view in views
        }
        self._on: dict[type, Callable[[Any], None]] = {
            Allocation: self._on_allocation,
            LinkCapacity: self._on_capacity,
            FrameCaptured: self._on_captured,
            FrameShown: self._on_shown,
            FrameQuality: self._on_quality,
            PacketBatch: self._on_packets,
            PolicyInputs: self._on_told,
        }

    def hear(self, record: Any) -> None:
        """Count a record, if it is one that counts."""
        if on_record := self._on.get(type(record)):
            on_record(record)

    def _on_allocation(self, allocation: Allocation) -> None:
        self._allocation = allocation

    def _on_capacity(self, capacity: LinkCapacity) -> None:
        self._capacity_kbps = capacity.capacity_kbps

    def _on_captured(self, frame: FrameCaptured) -> None:
        self._seconds[frame.view].captured += 1
        self._captures[frame.view].append((frame.index, frame.capture_ns))

    def _on_shown(self, frame: FrameShown) -> None:
        second = self._seconds[frame.view]
        second.shown += 1
        captures = self._captures[frame.view]
        while captures and captures[0][0] < frame.index:
            captures.popleft()
        if captures and captures[0][0] == frame.index:
            second.latency_ms.append((frame.shown_ns - captures[0][1]) / NS_PER_MS)

    def _on_quality(self, quality: FrameQuality) -> None:
        second = self._seconds[quality.view]
        if quality.live is not None:
            second.live.append(quality.live)
        if quality.received is not None:
            second.received.append(quality.received)

    def _on_told(self, inputs: PolicyInputs) -> None:
        if self._told is not None:
            for one in self._told.step(inputs.report().arrivals):
                self._count(
                    one.view,
                    one.kind.value,
                    one.size_bytes,
                    one.entered_ns,
                    one.departed_ns,
                    one.fate.value,
                )

    def _on_packets(self, batch: PacketBatch) -> None:
        self._told = None
        columns = zip(
            batch.view,
            batch.kind,
            batch.size_bytes,
            batch.entered_ns,
            batch.departed_ns,
            batch.fate,
            strict=True,
        )
        for column in columns:
            self._count(*column)

    def _count(
        self,
        view: str,
        kind: int,
        size_bytes: int,
        entered_ns: int,
        departed_ns: int,
        fate: int,
    ) -> None:
        if kind == PacketKind.RTCP.value:
            return
        second = self._seconds[view]
        second.packets += 1
        if kind == PacketKind.PADDING.value:
            second.padding_bytes += size_bytes
        else:
            second.sent_bytes += size_bytes
        second.lost += fate != PacketFate.DELIVERED.value
        if departed_ns:
            self._queue_ns = max(self._queue_ns or 0, departed_ns - entered_ns)

    def take(self, now_ns: int) -> Rates | None:
        """What the second amounts to that has ended by `now_ns`; None while none has."""
        passed_ns = now_ns - self._begun_ns
        if passed_ns < PERIOD_NS:
            return None
        passed_s = passed_ns / NS_PER_S
        seconds, allocation = self._seconds, self._allocation
        views = tuple(self._view(view, second, passed_s) for view, second in seconds.items())
        packets = sum(one.packets for one in seconds.values())
        sent_bits = sum(one.sent_bytes + one.padding_bytes for one in seconds.values()) * 8
        rates = Rates(
            t_ns=now_ns,
            target_kbps=None if allocation is None else sum(allocation.target_kbps.values()),
            sent_kbps=sent_bits / 1000 / passed_s if packets else None,
            budget_kbps=None if allocation is None else allocation.budget_kbps,
            capacity_kbps=self._capacity_kbps,
            estimate_kbps=None if allocation is None else finite(allocation.capacity_kbps),
            queue_ms=None if self._queue_ns is None else self._queue_ns / NS_PER_MS,
            loss=sum(one.lost for one in seconds.values()) / packets if packets else None,
            views=views,
        )
        self._begun_ns, self._queue_ns = now_ns, None
        self._seconds = {view: _Second() for view in self._views}
        return rates

    def _view(self, view: str, second: _Second, passed_s: float) -> ViewRates:
        allocation, packets = self._allocation, second.packets
        return ViewRates(
            view=view,
            target_kbps=None if allocation is None else allocation.target_kbps.get(view),
            sent_kbps=second.sent_bytes * 8 / 1000 / passed_s if packets else None,
            loss=second.lost / packets if packets else None,
            captured_fps=second.captured / passed_s,
            shown_fps=second.shown / passed_s,
            latency_ms=statistics.median(second.latency_ms) if second.latency_ms else None,
            live_ssim=statistics.fmean(second.live) if second.live else None,
            received_ssim=statistics.fmean(second.received) if second.received else None,
        )

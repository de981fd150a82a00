"""The sums of each second, which viewers get beside the records."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeAlias

from tams_app.capacity import finite
from tams_app.recording.topics import FrameCaptured, FrameShown, PacketBatch, Topic
from tams_app.records import (
    Allocation,
    FrameQuality,
    LinkCapacity,
    PacketRecord,
    PolicyInputs,
    TimeNs,
    ViewName,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.uplink_figures import ReportedPackets, UplinkFigures, uplink_figures

PERIOD_NS = NS_PER_S
_UNDER_WAY = 300  # captures of a view that may still be shown
_Loss: TypeAlias = Annotated[
    float | None,
    "share of datagrams that did not arrive, before repair; null: none were sent",
]


@dataclass(frozen=True, slots=True)
class ViewRates:
    """One view in one second."""

    view: ViewName
    target_kbps: Annotated[float | None, "target of the view [kbit/s of IP datagrams]"]
    sent_kbps: Annotated[
        float | None,
        "measured at the uplink, with repair, without padding [kbit/s]; with padding where "
        "receivers report it of a real one",
    ]
    loss: _Loss
    captured_fps: Annotated[float, "frames captured [1/s]"]
    shown_fps: Annotated[float, "frames shown [1/s]"]
    latency_ms: Annotated[float | None, "median from capture to shown [ms]; null: not known here"]
    live_ssim: Annotated[
        float | None,
        "mean SSIM of what was on the screen at capture, 0 to 1; null: not computed",
    ]
    received_ssim: Annotated[
        float | None, "mean SSIM of frames as shown, 0 to 1; null: not computed"
    ]
    task_live_ssim: Annotated[float | None, "as `live_ssim`, within the task's region"]
    task_received_ssim: Annotated[float | None, "as `received_ssim`, within the task's region"]


@dataclass(frozen=True, slots=True)
class Rates:
    """All views in one second; derived from the other records, for viewers alone."""

    t_ns: TimeNs  # its end
    target_kbps: Annotated[float | None, "sum of the views' targets [kbit/s of IP datagrams]"]
    sent_kbps: Annotated[
        float | None,
        "measured at the uplink, or reported by receivers of a real one: all views with repair and "
        "padding [kbit/s]",
    ]
    budget_kbps: Annotated[
        float | None, "B: the capacity after the safety factor [kbit/s of IP datagrams]"
    ]
    capacity_kbps: Annotated[
        float | None, "what the emulated network carries [kbit/s]; null: no limit"
    ]
    estimate_kbps: Annotated[
        float | None, "what the uplink is believed to carry [kbit/s]; null: no limit"
    ]
    queue_ms: Annotated[
        float | None, "longest wait at the bottleneck [ms]; null: no packet left it"
    ]
    loss: _Loss
    views: Annotated[tuple[ViewRates, ...], "the same for each view"]


RATES = Topic("/rates", Rates)


@dataclass(slots=True)
class _Second:
    """The counts of one view in a second."""

    captured: int = 0
    shown: int = 0
    latency_ms: list[float] = field(default_factory=list)
    scored: list[FrameQuality] = field(default_factory=list)


class RatesMeter:
    """Counts what is recorded, and gives the sums once a second.

    A packet counts when its fate is recorded, a score when it is. Where no network is emulated,
    packets are known by what receivers report, padding among them.
    """

    def __init__(self, views: tuple[str, ...], started_ns: int) -> None:
        self._views = views
        self._begun_ns = started_ns
        self._seconds = {view: _Second() for view in views}
        self._packets: list[PacketRecord] = []
        # None: the fates of all are known
        self._reported: ReportedPackets | None = ReportedPackets()
        self._allocation: Allocation | None = None
        self._capacity_kbps: float | None = None
        self._captures: dict[str, deque[tuple[int, int]]] = {
            view: deque(maxlen=_UNDER_WAY) for view in views
        }

    def step(self, record: Any, now_ns: int) -> Rates | None:
        """Count a record; the sums of a second that has ended by `now_ns`, None while none has."""
        self._count(record)
        return None if now_ns - self._begun_ns < PERIOD_NS else self._take(now_ns)

    def _count(self, record: Any) -> None:
        match record:
            case Allocation():
                self._allocation = record
            case LinkCapacity():
                self._capacity_kbps = record.capacity_kbps
            case FrameCaptured():
                self._seconds[record.view].captured += 1
                self._captures[record.view].append((record.index, record.capture_ns))
            case FrameShown():
                self._on_shown(record)
            case FrameQuality():
                self._seconds[record.view].scored.append(record)
            case PacketBatch():
                self._reported = None
                self._packets += record.packets()
            case PolicyInputs():
                if self._reported is not None:
                    self._packets += self._reported.step(record.report().arrivals)

    def _on_shown(self, frame: FrameShown) -> None:
        second = self._seconds[frame.view]
        second.shown += 1
        captures = self._captures[frame.view]
        while captures and captures[0][0] < frame.index:
            captures.popleft()
        if captures and captures[0][0] == frame.index:
            second.latency_ms.append((frame.shown_ns - captures[0][1]) / NS_PER_MS)

    def _take(self, now_ns: int) -> Rates:
        passed_ns = now_ns - self._begun_ns
        passed_s = passed_ns / NS_PER_S
        seconds, allocation = self._seconds, self._allocation
        figures = uplink_figures(self._packets, self._views, passed_ns)
        views = tuple(self._view(view, figures, passed_s) for view in seconds)
        rates = Rates(
            t_ns=now_ns,
            target_kbps=None if allocation is None else sum(allocation.target_kbps.values()),
            sent_kbps=figures.link_kbps,
            budget_kbps=None if allocation is None else allocation.budget_kbps,
            capacity_kbps=self._capacity_kbps,
            estimate_kbps=None if allocation is None else finite(allocation.capacity_kbps),
            queue_ms=figures.longest_queue_ms,
            loss=figures.loss,
            views=views,
        )
        self._begun_ns, self._packets = now_ns, []
        self._seconds = {view: _Second() for view in self._views}
        return rates

    def _view(self, view: str, figures: UplinkFigures, passed_s: float) -> ViewRates:
        allocation, second = self._allocation, self._seconds[view]
        return ViewRates(
            view=view,
            target_kbps=None if allocation is None else allocation.target_kbps.get(view),
            sent_kbps=figures.sent_kbps[view],
            loss=figures.view_loss[view],
            captured_fps=second.captured / passed_s,
            shown_fps=second.shown / passed_s,
            latency_ms=statistics.median(second.latency_ms) if second.latency_ms else None,
            live_ssim=_mean(one.live for one in second.scored),
            received_ssim=_mean(one.received for one in second.scored),
            task_live_ssim=_mean(one.task_live for one in second.scored),
            task_received_ssim=_mean(one.task_received for one in second.scored),
        )


def _mean(scores: Iterable[float | None]) -> float | None:
    known = [one for one in scores if one is not None]
    return statistics.fmean(known) if known else None

"""The log's long lists as numpy columns, and the statistics that every measure takes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.policy.weights import WeightMatrix
from tams_app.recording import SessionLog
from tams_app.records import PacketFate, PacketKind, PacketRecord, Phase
from tams_app.units import NS_PER_S
from tams_app.video.core.rate_control import FrameIntervals
from tams_app.video.core.uplink_figures import ReportedPackets


def known_packets(log: SessionLog) -> Sequence[PacketRecord]:
    """Their fates; where no network was emulated, what receivers reported (`ReportedPackets`)."""
    if log.packets:
        return log.packets
    reported = ReportedPackets()
    reports = (inputs.report() for inputs in log.policy_inputs)
    return [packet for report in reports for packet in reported.step(report.arrivals)]


@dataclass(frozen=True, slots=True)
class PacketTable:
    """Uplink datagrams as columns of one length; `view` is the place in `header.views`.

    `frame`: index of the capture that it carried a part of; −1 where the log does not tell.
    """

    view: Integers
    kind: Integers
    sequence: Integers
    size_bytes: Integers
    entered_ns: Integers
    departed_ns: Integers
    delivered_ns: Integers
    delivered: Integers  # 1 or 0
    rtp_timestamp: Integers
    frame: Integers

    @property
    def is_video(self) -> Flags:
        """Media, resends and parity, not RTCP or padding."""
        return ~np.isin(self.kind, (PacketKind.RTCP.value, PacketKind.PADDING.value))


@dataclass(frozen=True, slots=True)
class FrameTable:
    """One view's captures in order of index, and when each was shown (0: never).

    `usual_ns` is the time between frames that was usual when it was captured.
    """

    index: Integers
    capture_ns: Integers
    shown_ns: Integers
    usual_ns: Integers


@dataclass(frozen=True, slots=True)
class Targets:
    """The policy's targets, in order of time."""

    t_ns: Integers
    budget_kbps: Floats
    capacity_kbps: Floats  # as the policy believed it; NaN where it knew none
    kbps: dict[str, Floats]  # per view


@dataclass(frozen=True, slots=True)
class Span:
    """While video was asked for and captured [ns]: what the means of the rates are over."""

    start_ns: int
    end_ns: int

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / 1e9


class LogTables:
    """A log and its long lists as tables, each made once, when it is first asked for."""

    def __init__(self, log: SessionLog) -> None:
        """`log` does not change any more."""
        self.log = log
        self.places = {view: place for place, view in enumerate(log.header.views)}

    @cached_property
    def packets(self) -> PacketTable:
        """All that entered the uplink."""
        return self.table_of(known_packets(self.log))

    def table_of(self, packets: Sequence[PacketRecord]) -> PacketTable:
        """A table of packets of the log's views."""
        indices = self.indices if self.log.packets else {}
        rows = [
            (
                self.places.get(packet.view, -1),
                packet.kind.value,
                packet.sequence,
                packet.size_bytes,
                packet.entered_ns,
                packet.departed_ns,
                packet.delivered_ns,
                packet.fate is PacketFate.DELIVERED,
                packet.rtp_timestamp,
                indices.get(packet.view, {}).get(packet.rtp_timestamp, -1),
            )
            for packet in packets
        ]
        return PacketTable(*np.array(rows, dtype=np.int64).reshape(len(rows), 10).T)

    @cached_property
    def indices(self) -> dict[str, dict[int, int]]:
        """By view, `capture_indices`."""
        return {view: capture_indices(self.log, view) for view in self.places}

    @cached_property
    def frames(self) -> dict[str, FrameTable]:
        """By view, also of one that the header does not name."""
        views = {*self.places, *(one.view for one in self.log.captured)}
        return {view: self._frames(view) for view in views}

    def _frames(self, view: str) -> FrameTable:
        log = self.log
        captured = {one.index: one.capture_ns for one in log.captured if one.view == view}
        shown: dict[int, int] = {}
        for one in log.shown:
            if one.view == view and one.index in captured:
                shown[one.index] = min(one.shown_ns, shown.get(one.index, one.shown_ns))
        index = np.array(sorted(captured), dtype=np.int64)
        capture_ns = np.array([captured[number] for number in index], dtype=np.int64)
        shown_ns = np.array([shown.get(number, 0) for number in index.tolist()], dtype=np.int64)
        usual_ns = _usual_intervals_ns(capture_ns, log.header.fps)
        return FrameTable(index, capture_ns, shown_ns, usual_ns)

    @cached_property
    def targets(self) -> Targets:
        """What the policy asked for."""
        ordered = sorted(self.log.allocations, key=attrgetter("t_ns"))
        return Targets(
            np.array([one.t_ns for one in ordered], dtype=np.int64),
            np.array([one.budget_kbps for one in ordered], dtype=np.float64),
            np.array([one.capacity_kbps for one in ordered], dtype=np.float64),
            {
                view: np.array([one.target_kbps.get(view, 0) for one in ordered], dtype=np.float64)
                for view in self.places
            },
        )

    @cached_property
    def span(self) -> Span | None:
        """From the first allocation and capture to the end of the last capture; None without."""
        log = self.log
        if not log.captured or not log.allocations:
            return None
        first_capture_ns = min(frame.capture_ns for frame in log.captured)
        last = max(log.captured, key=attrgetter("capture_ns"))
        end_ns = last.capture_ns + int(self.frames[last.view].usual_ns[-1])
        start_ns = max(first_capture_ns, int(self.targets.t_ns[0]))
        return Span(start_ns, end_ns) if end_ns > start_ns else None


def phase_at(log: SessionLog, t_ns: Integers) -> Integers:
    """The number of the phase at each time, its place in `Phase`; −1 before the first."""
    changes = sorted(log.phases, key=attrgetter("t_ns"))
    began_ns = np.array([change.t_ns for change in changes], dtype=np.int64)
    numbers = {phase: number for number, phase in enumerate(Phase)}
    phase = np.array([-1, *(numbers[change.phase] for change in changes)], dtype=np.int64)
    return phase[np.searchsorted(began_ns, t_ns, side="right")]


def primary_at(log: SessionLog, t_ns: Integers) -> Integers:
    """The primary view at each time, its place in `header.views`; −1 where none is known."""
    weights, phases = WeightMatrix(log.header.weights), tuple(Phase)
    pins = sorted(log.pins, key=attrgetter("t_ns"))
    began = np.searchsorted(np.array([pin.t_ns for pin in pins], dtype=np.int64), t_ns, "right")
    pinned = ["", *(pin.view for pin in pins)]
    places = [
        -1
        if number < 0 or not log.header.weights
        else log.header.views.index(weights.primary_view(phases[number], pinned[pin]))
        for number, pin in zip(phase_at(log, t_ns), began, strict=True)
    ]
    return np.array(places, dtype=np.int64)


def capture_indices(log: SessionLog, view: str) -> dict[int, int]:
    """The captures of `view` that were sent: their indices by RTP timestamp."""
    return {
        one.rtp_timestamp: one.index
        for one in log.sent
        if one.view == view and one.rtp_timestamp is not None
    }


def _usual_intervals_ns(capture_ns: Integers, fps: int) -> Integers:
    intervals = FrameIntervals(NS_PER_S // fps)
    usual = [intervals.step(t_ns).usual_ns for t_ns in capture_ns.tolist()]
    return np.array([*usual[1:2], *usual[1:]] or usual, dtype=np.int64)


Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
Number: TypeAlias = float | None


def percentiles(values: Floats, names: Sequence[str]) -> dict[str, Number]:
    """For names such as p50, p99_9 and max: that percentile of the values that are not NaN.

    Null without any.
    """
    values = values[~np.isnan(values)]
    if not len(values):
        return dict.fromkeys(names)
    ranks = [100.0 if name == "max" else float(name[1:].replace("_", ".")) for name in names]
    found = np.percentile(values, ranks)
    return {name: round(float(value), 4) for name, value in zip(names, found, strict=True)}


def mean(values: Floats) -> Number:
    """Of the values that are not NaN; null without any."""
    known = values[~np.isnan(values)]
    return round(float(np.mean(known)), 4) if len(known) else None


def ratio(part: float, whole: float) -> Number:
    """`part`/`whole`, null when there is no whole."""
    return round(float(part / whole), 6) if whole > 0 else None


def step_mean(times_ns: Integers, values: Floats, span: Span | None) -> Number:
    """Mean over the span of a quantity that keeps each value until the next time.

    Before the first time it has the first value; null without values or span.
    """
    if span is None or not len(values):
        return None
    order = np.argsort(times_ns, kind="stable")
    edges = np.clip(np.append(times_ns[order], span.end_ns), span.start_ns, span.end_ns)
    edges[0] = span.start_ns
    durations = np.diff(edges)
    return round(float(np.sum(durations * values[order]) / (span.end_ns - span.start_ns)), 4)


def last_before(times_ns: Integers, values: Floats, at_ns: Integers) -> Floats:
    """The value in force at each of `at_ns`; NaN before the first. `times_ns` ascending."""
    position = np.searchsorted(times_ns, at_ns, side="right") - 1
    return np.where(position >= 0, values[np.maximum(position, 0)], np.nan)

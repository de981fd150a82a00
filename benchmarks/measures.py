"""From finished sessions to figures; each function measures one part."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.runs import Run
from tams_app.summary.tables import LogTables
from tams_app.summary.views import Windows, steps, windows
from tams_app.units import NS_PER_S

SETTLED_FRACTION = 0.15  # of the target


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number with its target."""

    group: str
    name: str
    value: float | None
    unit: str
    at_most: float | None = None
    at_least: float | None = None

    @property
    def verdict(self) -> str:
        """met, missed, or "" where there is no target or nothing was measured."""
        if self.value is None or (self.at_most is None and self.at_least is None):
            return ""
        low = self.at_least is None or self.value >= self.at_least
        high = self.at_most is None or self.value <= self.at_most
        return "met" if low and high else "missed"

    @property
    def target(self) -> str:
        if self.at_most is not None:
            return f"≤ {self.at_most:g}"
        return f"≥ {self.at_least:g}" if self.at_least is not None else ""


def start_figures(runs: list[Run]) -> list[Figure]:
    """From the command to the arm's first motion."""
    times = [run.first_motion_s for run in runs if run.first_motion_s is not None]
    value = max(times) if times else None
    return [Figure("start", "command to first motion, worst", value, "s", at_most=10)]


def control_figures(runs: list[Run]) -> list[Figure]:
    """Punctuality over all sessions together, tick cost, SDK round trip."""
    started = [np.array([tick.started_ns for tick in run.log.ticks]) for run in runs]
    period_ns = 1e9 / runs[0].log.header.control_rate_hz
    errors = np.concatenate([np.abs(np.diff(each) - period_ns) for each in started]) / 1e6
    cost = np.concatenate(
        [[tick.finished_ns - tick.started_ns for tick in run.log.ticks] for run in runs]
    )
    late = sum(run.summary["control"]["late"] for run in runs)
    due = sum(run.summary["control"]["ticks"] + run.summary["control"]["skipped"] for run in runs)
    seconds = sum(len(run.log.ticks) for run in runs) * period_ns / 1e9
    trips = [run.summary["arm"]["round_trip_ms"] for run in runs]

    def figure(name: str, value: float | None, unit: str = "ms", **others: float) -> Figure:
        return Figure("control", name, value, unit, **others)

    return [
        figure("time measured", seconds, "s", at_least=60),
        figure("late", 100 * late / due, "%", at_most=0.5),
        figure("period error p99", _rank(errors, 99)),
        figure("period error p99.9", _rank(errors, 99.9), at_most=3),
        figure("tick cost p50", _rank(cost / 1e6, 50)),
        figure("tick cost p99", _rank(cost / 1e6, 99)),
        figure("SDK round trip p50", _maximum(trip["p50"] for trip in trips)),
        figure("SDK round trip p99", _maximum(trip["p99"] for trip in trips)),
    ]


def video_figures(runs: list[Run]) -> list[Figure]:
    """How well the measured rate meets the target, and how soon after a phase change."""
    errors = [
        view["tracking_error"]
        for run in runs
        for view in run.summary["views"].values()
        if view["tracking_error"] is not None
    ]
    settled = [time for run in runs for time in _settling_times_s(run)]
    known = [time for time in settled if time is not None]
    return [
        Figure("video", "tracking error, mean", 100 * float(np.mean(errors)) if errors else None,
               "%", at_most=5),
        Figure("video", "settling after a step, median", _median_ms(known), "ms", at_most=270),
        Figure("video", "steps settled", 100 * len(known) / len(settled) if settled else None, "%"),
    ]  # fmt: skip


def latency_figures(run: Run) -> list[Figure]:
    """Loopback at 1500 kbit/s a view: sender's push to receiver's mailbox, and what is around."""
    sent = {(frame.view, frame.index): frame for frame in run.log.sent}
    both = [(sent[frame.view, frame.index], frame) for frame in run.log.shown]
    rendered = np.array([one.pushed_ns - one.capture_ns for one, _ in both]) / 1e6
    encoded = np.array([one.encoded_ns - one.pushed_ns for one, _ in both]) / 1e6
    carried = np.array([shown.shown_ns - one.encoded_ns for one, shown in both]) / 1e6

    def figure(name: str, values: np.ndarray, rank: float, at_most: float | None = None) -> Figure:
        return Figure("latency", f"{name} p{rank:g}", _rank(values, rank), "ms", at_most)

    return [
        figure("push to mailbox", encoded + carried, 50, at_most=8),
        figure("push to mailbox", encoded + carried, 99, at_most=20),
        figure("of it encoding", encoded, 50),
        figure("of it network, jitter buffer, decoding", carried, 50),
        figure("before: rendering and hand-over", rendered, 50),
        figure("capture to mailbox", rendered + encoded + carried, 50),
    ]


def rig_figures(runs: list[Run]) -> list[Figure]:
    """Frames per second, and the load of every process [% of one core]."""
    rates = [_frame_rate(run, view) for run in runs for view in run.log.header.views]
    samples = [sample for run in runs for sample in run.log.system]
    names = sorted({name for sample in samples for name in sample.helper_cpu_percent})
    load = [
        Figure("load", name, _mean(one.helper_cpu_percent.get(name, 0.0) for one in samples), "%")
        for name in names
    ]
    app = _mean(sample.app_cpu_percent for sample in samples)
    return [
        Figure("rig", "frames per second, worst view", min(rates), "/s", at_least=29.5),
        Figure("load", "application", app, "%"),
        *load,
    ]


def _settling_times_s(run: Run) -> list[float | None]:
    """One per target step of a view that has 500 ms to settle in."""
    tables = LogTables(run.log)
    times: list[float | None] = []
    for view in run.log.header.views:
        found = windows(tables, view)
        at = steps(tables.targets, view)
        for begin, end in pairwise([*at, found.end_ns[-1]]):
            if end - begin >= 1_000_000_000 and begin != at[0]:
                times.append(settling_time_s(found, int(begin), int(end)))
    return times


def _frame_rate(run: Run, view: str) -> float:
    captures = sorted(frame.capture_ns for frame in run.log.captured if frame.view == view)
    return (len(captures) - 1) / ((captures[-1] - captures[0]) / 1e9)


def _rank(values: np.ndarray, rank: float) -> float:
    return float(np.percentile(values, rank))


def _median_ms(seconds: list[float]) -> float | None:
    return 1000 * float(np.median(seconds)) if seconds else None


def _maximum(values: Iterable[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def settling_time_s(found: Windows, step_ns: int, until_ns: int) -> float | None:
    """From a step to the start of the first window from which all stay within ±15 %.

    Only windows inside [step, until) count; null if the last of them is outside, or there is none.
    """
    inside = (found.start_ns >= step_ns) & (found.end_ns <= until_ns)
    outside = np.abs(found.error[inside]) > SETTLED_FRACTION
    if not len(outside) or outside[-1]:
        return None
    bad = np.flatnonzero(outside)
    first = bad[-1] + 1 if len(bad) else 0
    return float(found.start_ns[inside][first] - step_ns) / NS_PER_S

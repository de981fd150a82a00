"""The control loop and the arm: punctuality, cost, round trips, stops."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.summary.tables import percentiles, ratio
from tams_app.units import NS_PER_MS, NS_PER_S

LATE_NS = NS_PER_MS


def control(log: SessionLog) -> dict[str, Any]:
    """`late`: started more than 1 ms after due, or skipped; fractions are of all due ticks."""
    ticks = log.ticks
    due = np.array([tick.due_ns for tick in ticks], dtype=np.int64)
    started = np.array([tick.started_ns for tick in ticks], dtype=np.int64)
    finished = np.array([tick.finished_ns for tick in ticks], dtype=np.int64)
    skipped = np.array([tick.skipped for tick in ticks], dtype=np.int64)
    total_skipped = int(skipped[-1]) if ticks else 0
    late = int(np.sum(started - due > LATE_NS)) + total_skipped
    period_ns = NS_PER_S / log.header.control_rate_hz
    # a tick that the log lost (recorder too slow) must not read as a late one
    passed = np.round(np.diff(due) / period_ns) - 1
    neighbours = passed == np.diff(skipped)
    error_ns = np.abs(np.diff(started) - period_ns)[neighbours]
    return {
        "rate_hz": log.header.control_rate_hz,
        "ticks": len(ticks),
        "late": late,
        "skipped": total_skipped,
        "late_fraction": ratio(late, len(ticks) + total_skipped),
        "period_error_ms": percentiles(error_ns / NS_PER_MS, ("p50", "p99", "p99_9", "max")),
        "tick_cost_ms": percentiles((finished - started) / NS_PER_MS, ("p50", "p99", "max")),
        "scheduler": log.facts.get("scheduler"),
    }


def arm(log: SessionLog) -> dict[str, Any]:
    """Round trips of the commands that were acknowledged, and every stop that was not a release."""
    replies = {
        tick.link.acknowledged_ns: tick.link.round_trip_ns
        for tick in log.ticks
        if tick.link.acknowledged_ns > 0
    }
    round_trip_ms = np.array(list(replies.values()), dtype=np.float64) / NS_PER_MS
    return {
        "servo": log.header.servo,
        "round_trip_ms": percentiles(round_trip_ms, ("p50", "p99", "max")),
        "stops": [
            {
                "t_s": seconds(log, stop.visible_ns),
                "reason": stop.reason,
                "stop_time_ms": None
                if stop.stopped_ns is None
                else round((stop.stopped_ns - stop.visible_ns) / NS_PER_MS, 3),
            }
            for stop in log.stops
        ],
    }


def phases(log: SessionLog) -> list[dict[str, Any]]:
    """Each phase with its start and the line of Algorithm 1 that decided."""
    return [
        {
            "t_s": seconds(log, change.t_ns),
            "phase": change.phase.value,
            "reason": change.reason,
        }
        for change in log.phases
    ]


def seconds(log: SessionLog, t_ns: int) -> float:
    """Seconds since the session started."""
    return round((t_ns - log.header.started_ns) / NS_PER_S, 4)

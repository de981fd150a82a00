"""Frames a second, asked and given, and what is short where too few were given."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.summary.tables import FrameTable, Span, mean, percentiles
from tams_app.units import NS_PER_MS

ENOUGH = 0.8  # of what was asked
_LEAST_FPS = 5  # that can be asked for


def view_rate(log: SessionLog, view: str, frames: FrameTable, span: Span | None) -> dict[str, Any]:
    """Frames a second of one view over the span, and the times between them."""
    given: float | None = None
    if span is not None:
        first, end = np.searchsorted(frames.capture_ns, [span.start_ns, span.end_ns])
        given = round(float(end - first) / span.seconds, 2)
    intervals_ms = np.diff(frames.capture_ns) / NS_PER_MS
    return {
        "fps": {"asked": log.header.fps, "given": given},
        "frames_damaged_at_camera": sum(one.damaged.get(view, 0) for one in log.rates),
        "frame_interval_ms": percentiles(intervals_ms, ("p50", "p95")),
    }


def rates(log: SessionLog, views: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The sentence on missing frames, null where every view was given enough.

    `views`: their entries in the summary.
    """
    given_fps = {view: entry["fps"]["given"] or 0.0 for view, entry in views.items()}
    if not log.captured or min(given_fps.values()) >= ENOUGH * log.header.fps:
        return {"shortfall": None}
    overrun_fps = {
        view: mean(np.array([one.overrun_fps.get(view, 0.0) for one in log.rates])) or 0.0
        for view in views
    }
    damaged = {view: entry["frames_damaged_at_camera"] for view, entry in views.items()}
    simulated = log.header.config.get("rig", {}).get("enabled", True)
    return {"shortfall": shortfall(log.header.fps, given_fps, overrun_fps, simulated, damaged)}


def shortfall(
    asked_fps: float,
    given_fps: Mapping[str, float],
    overrun_fps: Mapping[str, float],
    simulated: bool,
    damaged: Mapping[str, int] = MappingProxyType({}),
) -> str:
    """The cause of too few frames, and the remedy, in one sentence.

    Args:
        asked_fps: frames a second that were asked for.
        given_fps: by view, what came.
        overrun_fps: by view, what the camera had besides, which the session did not take.
        simulated: the cameras are the rig's.
        damaged: by view, how many came damaged and were left out.
    """
    given = ", ".join(f"{view} {fps:.1f}" for view, fps in given_fps.items())
    what = f"Too few frames: {given} per second of {asked_fps:g}"
    less_fps = max(int(min(given_fps.values())), _LEAST_FPS)
    less = f", or lower the rate with --fps {less_fps}" if less_fps < asked_fps else ""
    short = [view for view, fps in given_fps.items() if fps < ENOUGH * asked_fps]
    if all(given_fps[view] + overrun_fps.get(view, 0.0) >= ENOUGH * asked_fps for view in short):
        return f"{what}. The application missed the others: close other programs{less}."
    if simulated:
        return f"{what}. The machine rendered no more: close other programs{less}."
    if bad := [f"{count} of {view}" for view, count in damaged.items() if view in short and count]:
        return (
            f"{what}. Frames arrived damaged ({', '.join(bad)}) and were left out: check the "
            f"cables, or give each camera a USB port and bus of its own{less}."
        )
    return (
        f"{what}. The cameras delivered no more, as many do in dim light: add light or shorten "
        f"their exposure{less}."
    )

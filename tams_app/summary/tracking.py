"""How well the rate on the wire follows the target (docs/GLOSSARY.md, Measures).

Windows are 8 consecutive frames by capture index, sliding by one frame; the rate of a window is the
IP bytes of its frames' media and repair packets over 8 frame times. A frame that was dropped at the
source counts with no bytes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tams_app.recording import SessionLog
from tams_app.summary.tables import (
    RTP_CLOCK_HZ,
    Flags,
    Floats,
    FrameTable,
    Integers,
    Number,
    PacketTable,
    Targets,
    last_before,
    mean,
)
from tams_app.units import NS_PER_MS, NS_PER_S

WINDOW_FRAMES = 8
STEP_FRACTION = 0.10  # a change of the target by more than this is a step
LEFT_OUT_NS = 500 * NS_PER_MS  # after a step


@dataclass(frozen=True, slots=True)
class Windows:
    """One view's windows in order: when each begins and ends, its rate and its target."""

    start_ns: Integers
    end_ns: Integers
    sent_kbps: Floats
    target_kbps: Floats

    @property
    def error(self) -> Floats:
        """(sent − target)/target of each window."""
        return (self.sent_kbps - self.target_kbps) / self.target_kbps


def windows(
    log: SessionLog, view: str, frames: FrameTable, packets: PacketTable, targets: Targets
) -> Windows:
    """Every full window between the first and the last frame that was put on the wire."""
    period_ns = NS_PER_S // log.header.fps
    per_frame = wire_bytes(log, view, frames, packets)
    on_wire = np.flatnonzero(per_frame)
    inside = slice(on_wire[0], on_wire[-1] + 1) if len(on_wire) else slice(0, 0)
    index, capture_ns = frames.index[inside], frames.capture_ns[inside]
    target = last_before(targets.t_ns, targets.kbps[view], capture_ns)
    if len(index) < WINDOW_FRAMES:
        empty = np.empty(0)
        return Windows(empty.astype(np.int64), empty.astype(np.int64), empty, empty)
    last = WINDOW_FRAMES - 1
    total = _sliding_sum(per_frame[inside])
    window_target = _sliding_sum(target) / WINDOW_FRAMES
    whole = (index[last:] - index[:-last] == last) & (window_target > 0)
    return Windows(
        capture_ns[:-last][whole],
        capture_ns[last:][whole] + period_ns,
        (total * 8 * log.header.fps / WINDOW_FRAMES / 1000)[whole],
        window_target[whole],
    )


def wire_bytes(log: SessionLog, view: str, frames: FrameTable, packets: PacketTable) -> Floats:
    """IP bytes of media and repair of each captured frame, shape (frames,)."""
    mine = packets.is_video & (packets.view == log.header.views.index(view))
    ticks_per_frame = RTP_CLOCK_HZ / log.header.fps
    frame = np.round(packets.rtp_timestamp[mine] / ticks_per_frame).astype(np.int64)
    place = np.searchsorted(frames.index, frame)
    known = place < len(frames.index)
    known[known] = frames.index[place[known]] == frame[known]
    total: Floats = np.zeros(len(frames.index))
    np.add.at(total, place[known], packets.size_bytes[mine][known])
    return total


def steps(targets: Targets, view: str) -> Integers:
    """When the target of `view` stepped by more than 10 %; the first target is a step, too."""
    kbps = targets.kbps[view]
    changed = np.abs(np.diff(kbps)) > STEP_FRACTION * kbps[:-1]
    return targets.t_ns[np.append(True, changed)] if len(kbps) else targets.t_ns


def tracking_error(found: Windows, step_ns: Integers) -> Number:
    """Mean |sent − target|/target of the windows that no recent step touches."""
    touched: Flags = np.zeros(len(found.start_ns), dtype=np.bool_)
    for at_ns in step_ns:
        touched |= (found.end_ns > at_ns) & (found.start_ns < at_ns + LEFT_OUT_NS)
    return mean(np.abs(found.error[~touched]))


def _sliding_sum(values: Floats) -> Floats:
    total: Floats = sliding_window_view(values, WINDOW_FRAMES).sum(axis=1)
    return total

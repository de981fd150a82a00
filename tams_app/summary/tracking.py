"""Tracking of the target by the rate on the wire (docs/GLOSSARY.md, Measures).

Windows are 8 consecutive frames, or as many as come nearest to 270 ms if that is more, sliding by
one frame. The rate of a window is the IP bytes of its frames' media and repair packets over the
time from its first capture to the one after its last. A frame that was dropped at the source counts
with no bytes. No window spans a gap in which the camera missed two frames or more in a row, or
a time before or after the operator's side of two has been received.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tams_app.recording import SessionLog
from tams_app.summary.tables import (
    Flags,
    Floats,
    Integers,
    LogTables,
    Number,
    Targets,
    last_before,
    mean,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.rate_control import STEP_FRACTION, WINDOW_FRAMES, WINDOW_NS

LEFT_OUT_NS = 500 * NS_PER_MS  # after a step
GAP_INTERVALS = 2.5  # of the usual time between frames


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


def windows(tables: LogTables, view: str) -> Windows:
    """Every full window between the first and the last frame that was put on the wire."""
    frames, targets = tables.frames[view], tables.targets
    per_frame = wire_bytes(tables, view)
    on_wire = np.flatnonzero(per_frame)
    inside = slice(on_wire[0], on_wire[-1] + 1) if len(on_wire) else slice(0, 0)
    start_ns, usual_ns = frames.capture_ns[inside], frames.usual_ns[inside]
    end_ns = np.append(start_ns, start_ns[-1:] + usual_ns[-1:])[1:]
    target = last_before(targets.t_ns, targets.kbps[view], start_ns)  # NaN before the first
    first = np.arange(len(start_ns))
    enough = np.searchsorted(end_ns, start_ns + WINDOW_NS - usual_ns // 2)
    last = np.maximum(first + WINDOW_FRAMES - 1, enough)
    first, last = first[last < len(first)], last[last < len(first)]

    def total(values: Floats | Flags) -> Floats:
        cumulated = np.append(0.0, np.cumsum(values))
        found: Floats = cumulated[last + 1] - cumulated[first]
        return found

    durations_ns = end_ns - start_ns
    gap = durations_ns > GAP_INTERVALS * usual_ns
    left_out = total(np.isnan(target) | gap | _without_operator(tables.log, start_ns))
    time_ns = (end_ns[last] - start_ns[first]).astype(np.float64)
    window_target = total(np.nan_to_num(target) * durations_ns) / time_ns
    whole = (left_out == 0) & (window_target > 0)
    sent_kbps = total(per_frame[inside]) * 8 / 1000 / (time_ns / NS_PER_S)
    return Windows(
        start_ns[first][whole], end_ns[last][whole], sent_kbps[whole], window_target[whole]
    )


def _without_operator(log: SessionLog, start_ns: Integers) -> Flags:
    """Whether no operator was connected then; never on one computer."""
    received_ns = [one.t_ns for one in log.hands_received]
    if not received_ns:
        return np.zeros(len(start_ns), dtype=np.bool_)
    before: Flags = start_ns < min(received_ns)
    after: Flags = start_ns > max(received_ns)
    return before | after


def wire_bytes(tables: LogTables, view: str) -> Floats:
    """IP bytes of media and repair of each captured frame, shape (frames,)."""
    packets, index = tables.packets, tables.frames[view].index
    mine = packets.is_video & (packets.view == tables.places[view])
    frame = packets.frame[mine]
    place = np.searchsorted(index, frame)
    known = place < len(index)
    known[known] = index[place[known]] == frame[known]
    total: Floats = np.zeros(len(index))
    np.add.at(total, place[known], packets.size_bytes[mine][known])
    return total


def steps(targets: Targets, view: str) -> Integers:
    """The steps of `view`'s target by more than 10 %; the first target is a step, too."""
    kbps = targets.kbps[view]
    changed = np.abs(np.diff(kbps)) > STEP_FRACTION * kbps[:-1]
    return targets.t_ns[np.append(True, changed)] if len(kbps) else targets.t_ns


def tracking_error(found: Windows, step_ns: Integers) -> Number:
    """Mean |sent − target|/target of the windows that no recent step touches."""
    touched: Flags = np.zeros(len(found.start_ns), dtype=np.bool_)
    for at_ns in step_ns:
        touched |= (found.end_ns > at_ns) & (found.start_ns < at_ns + LEFT_OUT_NS)
    return mean(np.abs(found.error[~touched]))

"""Quality of the frames: SSIM of each view, and of the primary view by phase.

From the log alone. A view's figures are means over the frames that were scored (`ssim_n` of them:
the machine may not have had time for all; the sampled fraction is the share of the captured frames
that have a score). The primary view of a frame is the one with the largest weight in the phase at
its capture, whatever the strategy, or that was pinned then; before the first phase there is none.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import FrameQuality, PacketKind, Phase
from tams_app.summary.tables import (
    Flags,
    Floats,
    Integers,
    LogTables,
    Number,
    mean,
    phase_at,
    primary_at,
    ratio,
)
from tams_app.video.core.concealment import concealed_frames

WHOLE_KINDS = ("received_ssim", "delivered_ssim", "live_ssim")
TASK_KINDS = tuple(f"task_{kind}" for kind in WHOLE_KINDS)  # the same within the task's region
SSIM_KINDS = (*WHOLE_KINDS, *TASK_KINDS)
INTACT = "undamaged_received_ssim"


@dataclass(frozen=True, slots=True)
class QualityTable:
    """Frames of several views as columns; scores by kind are NaN where there is none.

    `view` is the place in `header.views`, `phase` that in `Phase`, −1 before the first.
    `concealed` is 1 where the decoder filled in for lost data, 0 where not, NaN where the frame was
    not shown or the log does not show it; `concealed_frames` are the indices by view, None where
    the log has no packets of the view.
    `packets` are those that carried the frame, resends apart; NaN without a log of them.
    `is_primary`: whether its view was the primary one when it was captured. `captured` are view,
    phase and that of all frames that were captured, shape (n, 3).
    """

    view: Integers
    phase: Integers
    is_primary: Flags
    scores: dict[str, Floats]
    concealed: Floats
    concealed_frames: dict[str, set[int] | None]
    packets: Floats
    captured: Integers

    @staticmethod
    def of(tables: LogTables) -> QualityTable:
        log, places = tables.log, tables.places
        frames = [one for one in log.quality if one.view in places]
        rows = np.array([_scores(one) for one in frames], dtype=np.float64)
        captures = [(places.get(one.view, -1), one.capture_ns) for one in log.captured]
        view, capture_ns = np.array(captures, dtype=np.int64).reshape(len(captures), 2).T
        captured = [view, phase_at(log, capture_ns), primary_at(log, capture_ns) == view]
        concealed = {view: _concealed_and_shown(tables, view) for view in places}
        frame_view = np.array([places[one.view] for one in frames], dtype=np.int64)
        frame_ns = np.array([one.capture_ns for one in frames], dtype=np.int64)
        return QualityTable(
            frame_view,
            phase_at(log, frame_ns),
            primary_at(log, frame_ns) == frame_view,
            dict(zip(SSIM_KINDS, rows.reshape(len(frames), len(SSIM_KINDS)).T, strict=True)),
            np.array([_is_concealed(one, concealed[one.view]) for one in frames], dtype=np.float64),
            concealed,
            _packets_of(frames, tables),
            np.stack(captured, axis=1).astype(np.int64),
        )

    def means(self, chosen: Flags) -> dict[str, Number]:
        """The mean of each kind over the chosen frames that have it."""
        return {kind: mean(score[chosen]) for kind, score in self.scores.items()}

    def losses(self, chosen: Flags) -> dict[str, Number]:
        """Effects of loss: share of concealed frames among those shown, mean over the others.

        With it, how many packets a frame was: each of them can be lost.
        """
        intact = chosen & (self.concealed == 0)
        return {
            "damaged_fraction": mean(self.concealed[chosen]),
            INTACT: mean(self.scores["received_ssim"][intact]),
            "packets_per_frame": mean(self.packets[chosen]),
        }

    def counts(self, chosen: Flags) -> dict[str, int]:
        """The number of chosen frames with a score, of each kind."""
        return {kind: int(np.sum(~np.isnan(score[chosen]))) for kind, score in self.scores.items()}

    def scored(self, chosen: Flags) -> int:
        """The number of chosen frames with a score of any kind."""
        known = ~np.isnan(np.array(list(self.scores.values())))
        return int(np.sum(np.any(known, axis=0) & chosen))

    def primary_captures(self, phase: int) -> int:
        """The number of captured frames of whatever view was primary, in one phase."""
        return int(np.sum((self.captured[:, 1] == phase) & (self.captured[:, 2] == 1)))


def view_quality(log: SessionLog, view: str, table: QualityTable) -> dict[str, Any]:
    """The three means of one view, how many frames are behind each, how many concealed."""
    place = log.header.views.index(view)
    mine = table.view == place
    concealed = table.concealed_frames[view]
    return {
        **table.means(mine),
        "ssim_n": table.counts(mine),
        "ssim_sampled_fraction": ratio(
            table.scored(mine), int(np.sum(table.captured[:, 0] == place))
        ),
        "frames_damaged": None if concealed is None else len(concealed),
    }


def primary_quality(table: QualityTable) -> dict[str, Any]:
    """SSIM of the primary view: the mean of the phases' means, and by phase.

    `missing_phases` have no scored frame and no part in the mean; `time_weighted` counts each
    phase for as long as it lasted (by its frames).
    """
    by_phase: dict[str, dict[str, Any]] = {}
    frames: dict[str, int] = {}
    scored = captured = 0
    for number, phase in enumerate(Phase):
        chosen = (table.phase == number) & table.is_primary
        counts = table.counts(chosen)
        sampled = table.scored(chosen), table.primary_captures(number)
        scored, captured = scored + sampled[0], captured + sampled[1]
        if any(counts.values()):
            by_phase[phase.value] = {
                **table.means(chosen),
                **table.losses(chosen),
                "n": counts,
                "sampled_fraction": ratio(*sampled),
            }
            frames[phase.value] = int(np.sum(chosen))
    return {
        **{kind: _mean_of_phases(by_phase, kind, dict.fromkeys(frames, 1)) for kind in SSIM_KINDS},
        "time_weighted": {kind: _mean_of_phases(by_phase, kind, frames) for kind in SSIM_KINDS},
        "n": {kind: sum(one["n"][kind] for one in by_phase.values()) for kind in SSIM_KINDS},
        "sampled_fraction": ratio(scored, captured),
        "missing_phases": [phase.value for phase in Phase if phase.value not in by_phase],
        "by_phase": by_phase,
    }


def _scores(frame: FrameQuality) -> list[float]:
    whole = frame.received, frame.delivered, frame.live
    task = frame.task_received, frame.task_delivered, frame.task_live
    return [np.nan if score is None else score for score in (*whole, *task)]


def _mean_of_phases(
    by_phase: dict[str, dict[str, Any]], kind: str, weight_of: dict[str, int]
) -> Number:
    means = {phase: one[kind] for phase, one in by_phase.items() if one[kind] is not None}
    if not means:
        return None
    weights = [weight_of[phase] for phase in means]
    return round(float(np.average(list(means.values()), weights=weights)), 4)


def _concealed_and_shown(tables: LogTables, view: str) -> set[int] | None:
    """Indices of the concealed frames that were shown; None where the log has no packets of it."""
    log = tables.log
    packets = [packet for packet in log.packets if packet.view == view]
    if not packets:
        return None
    keyframe_of = {frame.index: frame.keyframe for frame in log.sent if frame.view == view}
    shown_ns: dict[int, int] = {}
    for one in log.shown:
        if one.view == view:
            shown_ns.setdefault(one.index, one.shown_ns)
    return concealed_frames(keyframe_of, packets, shown_ns, tables.indices[view]) & shown_ns.keys()


def _packets_of(frames: list[FrameQuality], tables: LogTables) -> Floats:
    packets = tables.packets
    media = packets.kind == PacketKind.MEDIA.value
    sent = Counter(zip(packets.view[media].tolist(), packets.frame[media].tolist(), strict=True))
    found = [sent[tables.places[one.view], one.index] for one in frames]
    return np.array([count or np.nan for count in found], dtype=np.float64)


def _is_concealed(frame: FrameQuality, concealed: set[int] | None) -> float:
    if concealed is None or frame.shown_ns is None:
        return np.nan
    return float(frame.index in concealed)

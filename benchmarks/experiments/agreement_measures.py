"""What two runs of one recorded hand are compared by."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from benchmarks.experiments.replay import Replay
from tams_app.recording import FrameSent
from tams_app.records import FrameQuality, PacketFate, PacketKind, PacketRecord
from tams_app.summary.tables import LogTables, step_mean
from tams_app.summary.views import rate_kbps
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.rate_control import freeze_ns

KINDS = ("received", "delivered", "live")
PRIMARY = "primary"
Measures = dict[str, float | None]


def view_measures(replay: Replay, view: str) -> Measures:
    """Rates, times, frames and loss of one view; SSIM over all frames that have a score."""
    log, span = replay.log, replay.span
    tables = LogTables(log)
    mine = tables.packets.is_video & (tables.packets.view == log.header.views.index(view))
    media = [
        one
        for one in log.packets
        if one.view == view and one.kind is not PacketKind.RTCP and replay.inside(one.entered_ns)
    ]
    quality = [one for one in log.quality if one.view == view and replay.inside(one.capture_ns)]
    return {
        "target_kbps": step_mean(tables.targets.t_ns, tables.targets.kbps[view], span),
        "sent_kbps": rate_kbps(tables.packets, mine, tables.packets.entered_ns, span),
        **{f"{kind}_ssim": _mean(scores(quality, kind)) for kind in KINDS},
        **{f"{kind}_ssim_n": float(len(scores(quality, kind))) for kind in KINDS},
        **_times(replay, view),
        **_frames(replay, view),
        "lost_share": _share(media, PacketFate.LOST),
        "overflowed_share": _share(media, PacketFate.OVERFLOW),
    }


def primary_measures(replay: Replay) -> Measures:
    """SSIM of whichever view was the primary one at each frame's capture."""
    frames = [
        one
        for one in replay.log.quality
        if replay.inside(one.capture_ns) and one.view == replay.primary_view(one.capture_ns)
    ]
    return {
        **{f"{kind}_ssim": _mean(scores(frames, kind)) for kind in KINDS},
        **{f"{kind}_ssim_n": float(len(scores(frames, kind))) for kind in KINDS},
    }


def scores(frames: Sequence[FrameQuality], kind: str) -> list[float]:
    """The scores of a kind that were computed."""
    return [score for one in frames if (score := getattr(one, kind)) is not None]


def matched_ssim(live: Replay, virtual: Replay, view: str, kind: str) -> list[tuple[float, float]]:
    """Scores of frames that both runs captured at the same moment of the hand, live and virtual.

    Live scores are samples; the virtual frame of the nearest moment, at most half a frame time
    away, stands beside each. `view` may be PRIMARY: then it must be the primary one in both runs.
    """
    half_ns = NS_PER_S // (2 * live.log.header.fps)
    found = []
    for name in live.log.header.views if view == PRIMARY else (view,):
        there = _scored(virtual, name, kind)
        times = np.array([t_ns for t_ns, _ in there], dtype=np.int64)
        for t_ns, frame in _scored(live, name, kind):
            place = int(np.argmin(np.abs(times - t_ns))) if len(times) else -1
            if place < 0 or abs(times[place] - t_ns) > half_ns:
                continue
            other = there[place][1]
            primaries = {
                live.primary_view(frame.capture_ns),
                virtual.primary_view(other.capture_ns),
            }
            if view != PRIMARY or primaries == {name}:
                found.append((getattr(frame, kind), getattr(other, kind)))
    return found


def _scored(replay: Replay, view: str, kind: str) -> list[tuple[int, FrameQuality]]:
    """Moment of the hand [ns] and frame, of those with a score."""
    return [
        (one.capture_ns - replay.hand_began_ns, one)
        for one in replay.log.quality
        if one.view == view and replay.inside(one.capture_ns) and getattr(one, kind) is not None
    ]


def _times(replay: Replay, view: str) -> Measures:
    """Where a frame's time goes [ms], medians; `latency` is the sum of all of it."""
    sent = {one.index: one for one in _sent(replay, view)}
    shown = {one.index: one.shown_ns for one in reversed(replay.log.shown) if one.view == view}
    both = [(one, shown[index]) for index, one in sent.items() if index in shown]
    latency = [(shown_ns - one.capture_ns) / NS_PER_MS for one, shown_ns in both]
    return {
        "latency_p50_ms": _percentile(latency, 50),
        "latency_p95_ms": _percentile(latency, 95),
        "capture_to_sender_p50_ms": _percentile(
            [(one.pushed_ns - one.capture_ns) / NS_PER_MS for one in sent.values()], 50
        ),
        "encoding_p50_ms": _percentile(
            [(one.encoded_ns - one.pushed_ns) / NS_PER_MS for one in sent.values()], 50
        ),
        "encoded_to_shown_p50_ms": _percentile(
            [(shown_ns - one.encoded_ns) / NS_PER_MS for one, shown_ns in both], 50
        ),
    }


def _frames(replay: Replay, view: str) -> Measures:
    """What became of the frames, and how large they are by type."""
    captured = [
        one.index
        for one in replay.log.captured
        if one.view == view and replay.inside(one.capture_ns)
    ]
    places = captured[-1] - captured[0] + 1 if captured else 0
    shown = sorted(
        {
            one.shown_ns
            for one in replay.log.shown
            if one.view == view and replay.inside(one.shown_ns)
        }
    )
    longest_ns = freeze_ns(NS_PER_S // replay.log.header.fps)
    frozen = [after - before for before, after in pairwise(shown) if after - before > longest_ns]
    sent = _sent(replay, view)
    keyframes = [one.size_bytes for one in sent if one.keyframe]
    return {
        "frames_missed_by_renderer_share": _ratio(places - len(captured), places),
        "frames_sent_share": _ratio(len(sent), len(captured)),
        "frames_shown_share": _ratio(len(shown), len(captured)),
        "frozen_s": sum(frozen) / NS_PER_S,
        "keyframes": float(len(keyframes)),
        "keyframe_bytes": _mean(keyframes),
        "other_frame_bytes": _mean([one.size_bytes for one in sent if not one.keyframe]),
    }


def _sent(replay: Replay, view: str) -> list[FrameSent]:
    return [one for one in replay.log.sent if one.view == view and replay.inside(one.capture_ns)]


def _share(packets: Sequence[PacketRecord], fate: PacketFate) -> float | None:
    return _ratio(sum(one.fate is fate for one in packets), len(packets))


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _percentile(values: Sequence[float], rank: float) -> float | None:
    return float(np.percentile(values, rank)) if len(values) else None

"""The parts of a log that become episodes: the longest that are whole, with arm and all views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tams_app.errors import UnreadableLogError
from tams_app.export.lerobot.samples import Samples, TickTable
from tams_app.export.options import ExportOptions
from tams_app.outputs import is_plain_name
from tams_app.recording import Gap, Header, SessionLog, read_log, read_ticks, read_video
from tams_app.recording.topics import OutcomeGiven
from tams_app.records import Episode as EndedEpisode
from tams_app.records import Outcome, ServoMode
from tams_app.units import NS_PER_S

_MARGIN_NS = NS_PER_S  # of idle time at either end: a block counts as placed after half of it
_WITH_DAMAGED = "--with-damaged exports the longest part that is whole."
_NOT_JUDGED = Outcome(None, None, None, None, "")


class Shape(NamedTuple):
    """The common properties of all episodes of a dataset."""

    fps: int
    width: int
    height: int
    views: tuple[str, ...]

    def __str__(self) -> str:
        return (
            f"{', '.join(self.views)} with {self.width}x{self.height} at {self.fps} frames a second"
        )


@dataclass(frozen=True, slots=True)
class Episode:
    """An episode before its frames are read.

    start_ns: of the grid. keyframes_ns: by view, the capture that its decoding begins with.
    sizes: by view, the bytes that the log has of it between each row and the next, shape (rows,).
    remark: a sentence if the log was not whole, else "". number: of those of its session, None if
    without episodes.
    """

    path: Path
    header: Header
    shape: Shape
    start_ns: int
    samples: Samples
    keyframes_ns: Mapping[str, int]
    sizes: Mapping[str, NDArray[np.int64]]
    outcome: Outcome
    remark: str
    number: int | None = None

    @property
    def name(self) -> str:
        """That of the session's folder."""
        return _name(self.path)

    @property
    def rows(self) -> int:
        return len(self.samples.phase)

    @property
    def grid_ns(self) -> NDArray[np.int64]:
        """The instant of each row."""
        return _grid(self.start_ns, self.rows, self.shape.fps)


class _Captures(NamedTuple):
    """The recorded frames of a view, in order."""

    capture_ns: NDArray[np.int64]
    encoded_ns: NDArray[np.int64]
    keyframe: NDArray[np.bool_]
    size_bytes: NDArray[np.int64]


class _Wanted(NamedTuple):
    number: int | None
    when_ns: tuple[float, float]
    outcome: Outcome


class _Part(NamedTuple):
    start_ns: int
    end_ns: int
    keyframes_ns: dict[str, int]

    def is_less_than(self, other: _Part | None) -> bool:
        """Whether something of `other`, None for nothing, is not in it."""
        return other is not None and (self.start_ns > other.start_ns or self.end_ns < other.end_ns)


def read_episodes(
    path: Path, options: ExportOptions, notify: Callable[[str], None]
) -> list[Episode]:
    """The episodes in the log at `path`: one, or those kept of a session that is a row of them.

    `notify` gets a sentence on what is left out. UnreadableLogError in a sentence if there is none.
    """
    log = read_log(path, only=(OutcomeGiven, EndedEpisode))
    # a log with episodes that was cut off lacks none that had ended
    damage = "" if log.has_episodes and not log.gaps else log.damage
    if damage and not options.with_damaged and not log.has_episodes:
        raise UnreadableLogError(f"{path.parent}: {damage} {_WITH_DAMAGED}")
    wanted = _kept(path, log, options) if log.has_episodes else []
    outcome = log.outcome or _NOT_JUDGED
    if options.only_success and not log.has_episodes and not outcome.success:
        raise UnreadableLogError(
            f"{path.parent}: was not judged a success ({outcome.reason or 'there is no verdict'})"
        )
    shape = _shape(path, log.header)
    table = TickTable(read_ticks(path))
    if not len(table.times_ns):
        raise UnreadableLogError(
            f"{path.parent}: tells nothing of an arm: of two computers give the robot's log"
        )
    captures = {view: _captures(path, view) for view in shape.views}
    if not log.has_episodes:
        when_ns = (-np.inf, np.inf) if options.keep_idle else _busy(path, table, outcome)
        wanted = [_Wanted(None, when_ns, outcome)]
    found: dict[int | None, Episode] = {}
    for one in wanted:
        parts = [
            part
            for whole_ns in _whole(log.gaps)
            if (part := _part(whole_ns, one.when_ns, table.times_ns, captures)) is not None
        ]
        if not parts:
            continue
        part = max(parts, key=lambda one: one.end_ns - one.start_ns)
        is_cut = log.has_episodes and part.is_less_than(
            _part((-np.inf, np.inf), one.when_ns, table.times_ns, captures)
        )
        if is_cut and not options.with_damaged:
            continue
        rows = (part.end_ns - part.start_ns) * shape.fps // NS_PER_S + 1
        grid_ns = _grid(part.start_ns, rows, shape.fps)
        found[one.number] = Episode(
            path,
            log.header,
            shape,
            part.start_ns,
            table.sample(grid_ns),
            part.keyframes_ns,
            {view: _sizes(one, grid_ns) for view, one in captures.items()},
            one.outcome,
            _remark(_name(path), log, damage if is_cut or not log.has_episodes else "", part),
            one.number,
        )
    lacks = "has no moment with the arm and a picture of every view"
    if damage and log.has_episodes:
        lacks = damage if options.with_damaged else f"{damage} {_WITH_DAMAGED}"
    if not found:
        raise UnreadableLogError(f"{path.parent}: {lacks}")
    if log.has_episodes:
        taken = f"takes {_listed(found)} of {len(log.judged_episodes)} episodes"
        left = _listed(one.number for one in wanted if one.number not in found)
        notify(f"{_name(path)}: {taken}" + (f"; without {left}: {lacks}" if left else ""))
    return list(found.values())


def _listed(numbers: Iterable[int | None]) -> str:
    return ", ".join(map(str, numbers))


def _kept(path: Path, log: SessionLog, options: ExportOptions) -> list[_Wanted]:
    """The kept episodes as the operator began and ended them, labelled by them alone."""
    wanted = [
        _Wanted(
            one.number,
            (one.start_ns, one.end_ns - 1),
            Outcome(None, one.success, None, None, ""),
        )
        for one in log.judged_episodes
        if one.kept and (one.success or not options.only_success)
    ]
    if not wanted:
        what = "labelled a success" if options.only_success else "kept"
        raise UnreadableLogError(f"{path.parent}: no episode of it was {what}")
    return wanted


def _name(path: Path) -> str:
    return path.resolve().parent.name


def _grid(start_ns: int, rows: int, fps: int) -> NDArray[np.int64]:
    return start_ns + np.arange(rows, dtype=np.int64) * NS_PER_S // fps


def _shape(path: Path, header: Header) -> Shape:
    if header.servo != ServoMode.VELOCITY:
        raise UnreadableLogError(
            f"{path.parent}: its arm was led from pose to pose, which this version of TAMS does "
            "not know: use version 2 to export it"
        )
    video = header.config.get("video", {})
    for view in header.views:  # a folder of the dataset is named after it
        if not is_plain_name(view):
            raise UnreadableLogError(f"{path.parent}: a view is named {view!r}: cannot be a folder")
    try:
        size = int(video["width"]), int(video["height"])
        return Shape(header.fps, *size, tuple(header.views))
    except (KeyError, TypeError, ValueError) as error:
        raise UnreadableLogError(
            f"{path.parent}: does not say how large its pictures are"
        ) from error


def _captures(path: Path, view: str) -> _Captures:
    found = [
        (one.capture_ns, one.encoded_ns, one.keyframe, len(one.data))
        for one in read_video(path, view)
    ]
    if not found:
        raise UnreadableLogError(
            f"{path.parent}: holds no video of {view}: record with recording.bitstream: true"
        )
    captured, encoded, keyframe, sizes = zip(*found, strict=True)
    return _Captures(
        np.array(captured, np.int64),
        np.array(encoded, np.int64),
        np.array(keyframe, np.bool_),
        np.array(sizes, np.int64),
    )


def _sizes(captures: _Captures, grid_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The bytes of the frames from each instant to the next; those of the last row's own."""
    before = np.searchsorted(captures.capture_ns, grid_ns, side="right") - 1
    until = np.append(np.maximum(before[1:], before[:-1]), before[-1] + 1)
    total = np.append(0, np.cumsum(captures.size_bytes))
    return np.asarray(total[until] - total[before])


def _busy(path: Path, table: TickTable, outcome: Outcome) -> tuple[float, float]:
    """From before the first engagement to after the placing, or else after the last engagement."""
    engaged_ns = table.engaged_ns
    if not len(engaged_ns):
        raise UnreadableLogError(
            f"{path.parent}: the arm was never engaged; --keep-idle exports it all the same"
        )
    placed_s = outcome.completion_time_s
    last_ns = engaged_ns[-1] if placed_s is None else engaged_ns[0] + placed_s * NS_PER_S
    return float(engaged_ns[0] - _MARGIN_NS), float(last_ns + _MARGIN_NS)


def _whole(gaps: Sequence[Gap]) -> list[tuple[float, float]]:
    """From when to when the log is whole."""
    starts, ends = [-np.inf], []
    for gap in gaps:
        ends.append(-np.inf if gap.start_ns is None else gap.start_ns)
        starts.append(np.inf if gap.end_ns is None else gap.end_ns)
    return list(zip(starts, [*ends, np.inf], strict=True))


def _part(
    whole_ns: tuple[float, float],
    wanted_ns: tuple[float, float],
    ticks_ns: NDArray[np.int64],
    captures: Mapping[str, _Captures],
) -> _Part | None:
    """Between two gaps, of what is wanted what can be decoded, to when the last frame was taken."""
    lower_ns, upper_ns = whole_ns
    ticks = ticks_ns[(ticks_ns > lower_ns) & (ticks_ns < upper_ns)]
    if not len(ticks):
        return None
    start_ns, end_ns = int(max(ticks[0], wanted_ns[0])), int(min(ticks[-1], wanted_ns[1]))
    keyframes: dict[str, NDArray[np.int64]] = {}
    for view, (capture_ns, encoded_ns, keyframe, _) in captures.items():
        inside = (encoded_ns > lower_ns) & (encoded_ns < upper_ns)
        keyframes[view] = capture_ns[inside & keyframe]
        if not len(keyframes[view]):
            return None
        start_ns = max(start_ns, int(keyframes[view][0]))
        end_ns = min(end_ns, int(capture_ns[inside][-1]))
    if end_ns < start_ns:
        return None
    begun = {view: int(found[found <= start_ns][-1]) for view, found in keyframes.items()}
    return _Part(start_ns, end_ns, begun)


def _remark(name: str, log: SessionLog, damage: str, part: _Part) -> str:
    if not damage:
        return ""
    from_s, to_s = (
        (instant_ns - log.header.started_ns) / NS_PER_S
        for instant_ns in (part.start_ns, part.end_ns)
    )
    return f"{name}: {damage} Its episode is from {from_s:.1f} to {to_s:.1f} s."

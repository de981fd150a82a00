"""Clips of the phases of a recorded session: which stretches, composed how, and cut."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from datetime import UTC, datetime

import cv2
import numpy as np

from calibration.weights.clips import ClipFolder, ClipTimes, ClipWriter, CutSession
from calibration.weights.sources import RecordedSession, Segment
from tams_app.errors import UnreadableLogError
from tams_app.records import Frame, Image, Phase
from tams_app.units import NS_PER_S

SHORTEST_S = 0.5  # less cannot be judged
LONGEST_S = 8.0  # more wears the rater out


@dataclass(frozen=True, slots=True)
class Selection:
    """What to cut from a session, and how much of it was left out, in segments."""

    chosen: tuple[Segment, ...]  # in the order of Phase, at most one each
    too_short: int
    not_longest: int


def select(segments: Sequence[Segment]) -> Selection:
    """The longest segment of each phase that is that can be judged, shortened to LONGEST_S."""
    long_enough = [segment for segment in segments if segment.seconds >= SHORTEST_S]
    chosen = []
    for phase in Phase:
        of_phase = [segment for segment in long_enough if segment.phase is phase]
        if of_phase:
            longest = max(of_phase, key=lambda segment: segment.end_ns - segment.start_ns)
            chosen.append(_shortened(longest, is_last=longest is segments[-1]))
    return Selection(
        tuple(chosen), len(segments) - len(long_enough), len(long_enough) - len(chosen)
    )


def _shortened(segment: Segment, is_last: bool) -> Segment:
    """Its end, which leads into the next phase; of a session's last its beginning.

    A session begins and ends with an arm that waits: that shows nothing of the task.
    """
    limit_ns = round(LONGEST_S * NS_PER_S)
    if segment.end_ns - segment.start_ns <= limit_ns:
        return segment
    if is_last:
        return Segment(segment.phase, segment.start_ns, segment.start_ns + limit_ns)
    return Segment(segment.phase, segment.end_ns - limit_ns, segment.end_ns)


STRIP_HEIGHT = 32  # above the frames, for their names
_TEXT_BASELINE = 23
_TEXT_SCALE = 0.7
_INK, _PAPER = (255, 255, 255), 40


def instants(segment: Segment, fps: int) -> list[int]:
    """When a clip of `segment` needs frames [ns]; at least one."""
    count = max(1, (segment.end_ns - segment.start_ns) * fps // NS_PER_S)
    return [segment.start_ns + number * NS_PER_S // fps for number in range(count)]


def newest_at(
    frames: Iterable[Frame], wanted_ns: Sequence[int]
) -> Iterator[tuple[int, dict[str, Image]]]:
    """For each of `wanted_ns`, ascending: the newest frame of each view captured by then.

    `frames` come in the order of their captures. Reads on no further than it has to.
    """
    if not wanted_ns:
        return
    newest: dict[str, Image] = {}
    number = 0
    for frame in frames:
        while frame.capture_ns > wanted_ns[number]:
            yield wanted_ns[number], dict(newest)
            number += 1
            if number == len(wanted_ns):
                return
        newest[frame.view] = frame.image
    for instant in wanted_ns[number:]:
        yield instant, dict(newest)


def side_by_side(images: Mapping[str, Image], views: Sequence[str], phase: str) -> Image:
    """The views in one row under their names, and the phase's at the right; BGR."""
    frames = np.hstack([images[view] for view in views])
    height, width = frames.shape[:2]
    canvas = np.full((height + STRIP_HEIGHT, width, 3), _PAPER, dtype=np.uint8)
    canvas[STRIP_HEIGHT:] = frames
    for number, view in enumerate(views):
        _write(canvas, view.upper(), number * width // len(views) + 8)
    (length, _), _ = cv2.getTextSize(phase, cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE, 2)
    _write(canvas, phase, width - length - 8)
    return canvas


def _write(canvas: Image, text: str, x: int) -> None:
    at, font = (x, _TEXT_BASELINE), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(canvas, text, at, font, _TEXT_SCALE, _INK, 2, cv2.LINE_AA)


Progress = Callable[[Segment, float], None]  # the clip being cut, and how much of it [0..1]


def cut_session(
    session: RecordedSession, folder: ClipFolder, progress: Progress, context_s: float = 0.0
) -> CutSession:
    """Make the clips of `session` that are missing in `folder`; what was cut and left out.

    `context_s`: how much of what comes before and after a phase its clip shows too. LogError if
    the session has no phase that is long enough, or cannot be decoded.
    """
    selection = select(session.segments(context_s))
    if not selection.chosen:
        raise UnreadableLogError(f"{session.folder}: no phase lasts long enough for a clip")
    entry = _entry(session, selection, context_s)
    folder.add(session.name, entry)
    video, writers, added = session.video, dict[Segment, ClipWriter](), Counter[Segment]()
    wanted = {
        segment: instants(segment, video.fps)
        for segment in selection.chosen
        if not folder.file(segment.phase, session.name).is_file()
    }
    # with context the clips overlap: their frames are wanted in turns
    turns = sorted(
        ((t_ns, segment) for segment, times in wanted.items() for t_ns in times),
        key=lambda one: one[0],
    )
    with ExitStack() as stack:
        frames = stack.enter_context(closing(session.frames()))
        moments = newest_at(frames, [t_ns for t_ns, _ in turns])
        for (_, segment), (_, images) in zip(turns, moments, strict=True):
            if len(images) < len(video.views):
                raise UnreadableLogError(
                    f"{session.folder}: a view's frames begin too late to be cut"
                )
            if segment not in writers:
                width, height = len(video.views) * video.width, video.height + STRIP_HEIGHT
                path = folder.file(segment.phase, session.name)
                writers[segment] = ClipWriter(path, width, height, video.fps)
                stack.callback(writers[segment].close)  # gives up what is not finished
            writers[segment].add(side_by_side(images, video.views, segment.phase.value))
            added[segment] += 1
            if added[segment] == len(wanted[segment]):
                writers[segment].finish()
            progress(segment, added[segment] / len(wanted[segment]))
    return entry


def _entry(session: RecordedSession, selection: Selection, context_s: float) -> CutSession:
    header = session.log.header
    recorded_s = (header.started_ns + header.wall_offset_ns) / NS_PER_S
    return CutSession(
        recorded=datetime.fromtimestamp(recorded_s, UTC).isoformat(timespec="milliseconds"),
        shows=session.shows,
        constrained=session.is_constrained,
        rig=session.is_of_rig,
        context_s=context_s,
        too_short=selection.too_short,
        not_longest=selection.not_longest,
        clips={
            segment.phase: ClipTimes(
                start_s=round((segment.start_ns - header.started_ns) / NS_PER_S, 3),
                seconds=round(segment.seconds, 3),
            )
            for segment in selection.chosen
        },
    )

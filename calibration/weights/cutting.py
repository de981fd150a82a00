"""Recorded sessions, and the clips cut from them: which stretches, which frames, composed how.

Lossless captures are taken where the session kept some; else the bitstream of the log is decoded.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from operator import attrgetter, itemgetter
from pathlib import Path

import cv2
import numpy as np
from pydantic import ValidationError

from calibration.kit import Progress
from calibration.weights.clips import ClipFolder, ClipTimes, ClipWriter, CutSession
from tams_app.config import VideoConfig
from tams_app.config.section import describe_validation_error
from tams_app.config.whole import without_removed
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, UnreadableLogError
from tams_app.recording import LOG_NAME, SessionLog, read_log, read_video
from tams_app.recording.reference import read_reference
from tams_app.records import Frame, Image, Phase, PhaseChange
from tams_app.session.recorders import REFERENCE_NAME
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.codecs import bgr_of
from tams_app.video.live.codecs import decoded

SHORTEST_S = 0.5  # less cannot be judged
LONGEST_S = 8.0  # more wears the rater out


@dataclass(frozen=True, slots=True)
class Segment:
    """One uninterrupted stretch of a phase, with its context."""

    phase: Phase
    start_ns: int
    end_ns: int

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.start_ns) / NS_PER_S


def phase_segments(
    changes: Sequence[PhaseChange], first_ns: int, last_ns: int, context_s: float = 0.0
) -> list[Segment]:
    """The stretches between phase changes as far as they lie within [first_ns, last_ns].

    Each begins `context_s` earlier and ends that much later, as far as there are frames.
    """
    context_ns = round(context_s * NS_PER_S)
    ordered = sorted(changes, key=lambda change: change.t_ns)
    ends = [after.t_ns for _, after in pairwise(ordered)] + [last_ns]
    found = []
    for change, end_ns in zip(ordered, ends[: len(ordered)], strict=True):
        start_ns, end_ns = max(change.t_ns, first_ns), min(end_ns, last_ns)
        if end_ns > start_ns:
            around = max(start_ns - context_ns, first_ns), min(end_ns + context_ns, last_ns)
            found.append(Segment(change.phase, *around))
    return found


_GAP_NS = 500 * NS_PER_MS  # what a busy recorder may leave out


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """One session folder; its name distinguishes it from others."""

    folder: Path
    log: SessionLog
    video: VideoConfig

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def has_captures(self) -> bool:
        """Whether the frames are there as the cameras gave them."""
        return (self.folder / REFERENCE_NAME).is_file()

    @property
    def is_of_rig(self) -> bool:
        """Whether it shows the simulated rig."""
        return bool(self.log.header.config.get("rig", {}).get("enabled", False))

    @property
    def shows(self) -> str:
        """What a rater sees, in words."""
        if self.has_captures:
            return "lossless captures"
        network = self.log.header.network
        return "as sent, no bottleneck" if network == "none" else f"as sent over {network}"

    @property
    def is_constrained(self) -> bool:
        """Whether the frames suffered from a narrow uplink, which the paper's did not."""
        return not self.has_captures and self.log.header.network != "none"

    def segments(self, context_s: float = 0.0) -> list[Segment]:
        """Its phases, each with `context_s` before and after, as far as every view has frames.

        LogError if a view has none.
        """
        return phase_segments(self.log.phases, *self._span_ns, context_s)

    @property
    def _span_ns(self) -> tuple[int, int]:
        """From when to when every view was sent; LogError if one was not."""
        times = {
            view: [frame.capture_ns for frame in self.log.sent if frame.view == view]
            for view in self.video.views
        }
        for view, captured in times.items():
            if not captured:
                raise UnreadableLogError(
                    f"{self.folder}: has no frames of {view}; give another session"
                )
        first_ns = max(min(captured) for captured in times.values())
        return first_ns, min(max(captured) for captured in times.values())

    def frames(self) -> Generator[Frame]:
        """All views' frames in the order of their captures.

        LogError at their end if that comes before the session's: a full disk ends the lossless
        captures before the log, and a frozen frame must not pass for the rest.
        """
        newest_ns = dict.fromkeys(self.video.views, 0)
        with ExitStack() as stack:
            views = [stack.enter_context(closing(self._view(view))) for view in self.video.views]
            for frame in heapq.merge(*views, key=lambda frame: frame.capture_ns):
                newest_ns[frame.view] = frame.capture_ns
                yield frame
        _, last_ns = self._span_ns
        for view, end_ns in newest_ns.items():
            if end_ns < last_ns - _GAP_NS:
                missing_s = (last_ns - end_ns) / NS_PER_S
                raise UnreadableLogError(
                    f"{self.folder}: the last {missing_s:.1f} s have no frames of {view}: give "
                    f"another session too, or move {REFERENCE_NAME} away to cut what was sent"
                )

    def _view(self, view: str) -> Generator[Frame]:
        if self.has_captures:
            offset_ns = self.log.header.wall_offset_ns
            for frame in read_reference(self.folder / REFERENCE_NAME, offset_ns):
                if frame.view == view:
                    yield frame
            return
        with closing(decoded(read_video(self.folder / LOG_NAME, view))) as frames:
            for capture_ns, planes in frames:
                image = bgr_of(planes, self.video.height, self.video.width)
                yield Frame(view, 0, capture_ns, image)  # known by its time alone


def open_session(given: Path, views: Sequence[str]) -> RecordedSession:
    """The session in the folder `given`, or whose log that is; ConfigError or LogError if not."""
    folder = session_log(given).parent.resolve()
    log = read_log(folder / LOG_NAME)
    if set(log.header.views) != set(views):
        raise ConfigError(
            f"{folder}: shows the views {', '.join(log.header.views)}, the configuration has "
            f"{', '.join(views)}: give a session of this set-up"
        )
    if not log.phases:
        raise UnreadableLogError(f"{folder}: the log has no phases; give another session")
    kept = log.header.config.get("recording", {}).get("bitstream", True)
    if not kept and not (folder / REFERENCE_NAME).is_file():
        raise UnreadableLogError(
            f"{folder}: was recorded without frames; set recording.bitstream: true"
        )
    return RecordedSession(folder, log, _video(folder, log, views))


def _video(folder: Path, log: SessionLog, views: Sequence[str]) -> VideoConfig:
    """How the frames were made, the views in the order of the configuration."""
    made = without_removed(log.header.config).get("video", {})
    try:
        return VideoConfig.model_validate({**made, "views": tuple(views)})
    except ValidationError as error:
        raise UnreadableLogError(
            f"{folder}: was recorded by another version of TAMS: video."
            f"{describe_validation_error(error, VideoConfig)}; give another session"
        ) from error


def select(segments: Sequence[Segment]) -> list[Segment]:
    """The longest segment of each phase that is that can be judged, shortened to LONGEST_S."""
    long_enough = [segment for segment in segments if segment.seconds >= SHORTEST_S]
    chosen = []
    for phase in Phase:
        of_phase = [segment for segment in long_enough if segment.phase is phase]
        if of_phase:
            longest = max(of_phase, key=attrgetter("seconds"))
            chosen.append(_shortened(longest, is_last=longest is segments[-1]))
    return chosen


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


def cut_session(
    session: RecordedSession, folder: ClipFolder, progress: Progress, context_s: float = 0.0
) -> CutSession:
    """Make the clips of `session` that are missing in `folder`; what was cut and left out.

    `context_s`: how much of what comes before and after a phase its clip shows too. LogError if
    the session has no phase that is long enough, or cannot be decoded.
    """
    chosen = select(session.segments(context_s))
    if not chosen:
        raise UnreadableLogError(f"{session.folder}: no phase lasts long enough for a clip")
    entry = _entry(session, chosen, context_s)
    folder.add(session.name, entry)
    video, writers, added = session.video, dict[Segment, ClipWriter](), Counter[Segment]()
    wanted = {
        segment: instants(segment, video.fps)
        for segment in chosen
        if not folder.file(segment.phase, session.name).is_file()
    }
    # with context the clips overlap: their frames are wanted in turns
    turns = sorted(
        ((t_ns, segment) for segment, times in wanted.items() for t_ns in times),
        key=itemgetter(0),
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
            doing = f"{segment.phase.value}, {segment.seconds:.1f} s"
            progress(doing, added[segment] / len(wanted[segment]))
    return entry


def _entry(session: RecordedSession, chosen: Sequence[Segment], context_s: float) -> CutSession:
    header = session.log.header
    recorded_s = (header.started_ns + header.wall_offset_ns) / NS_PER_S
    return CutSession(
        recorded=datetime.fromtimestamp(recorded_s, UTC).isoformat(timespec="milliseconds"),
        shows=session.shows,
        constrained=session.is_constrained,
        rig=session.is_of_rig,
        context_s=context_s,
        clips={
            segment.phase: ClipTimes(
                start_s=round((segment.start_ns - header.started_ns) / NS_PER_S, 3),
                seconds=round(segment.seconds, 3),
            )
            for segment in chosen
        },
    )

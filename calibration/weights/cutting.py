"""Cuts a recorded session into one clip per phase; what is there already is not cut again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from datetime import UTC, datetime

from calibration.weights.clip_file import ClipWriter
from calibration.weights.clips import ClipFolder, ClipTimes, CutSession
from calibration.weights.composing import STRIP_HEIGHT, instants, newest_at, side_by_side
from calibration.weights.segments import Segment, Selection, select
from calibration.weights.sources import RecordedSession
from tams_app.errors import LogError
from tams_app.records import Image
from tams_app.runtime.clock import NS_PER_S

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
        raise LogError(f"{session.folder}: no phase lasts long enough for a clip")
    entry = _entry(session, selection, context_s)
    folder.add(session.name, entry)
    missing = [
        segment
        for segment in selection.chosen
        if not folder.file(segment.phase, session.name).is_file()
    ]
    with ExitStack() as stack:
        cuts = [_Cut(session, segment, folder) for segment in missing]
        for cut in cuts:
            stack.callback(cut.close)
        # with context the clips overlap: their pictures are wanted in turns
        turns = sorted(
            ((t_ns, cut) for cut in cuts for t_ns in cut.wanted_ns), key=lambda one: one[0]
        )
        pictures = stack.enter_context(closing(session.pictures()))
        moments = newest_at(pictures, [t_ns for t_ns, _ in turns])
        for (_, cut), (_, images) in zip(turns, moments, strict=True):
            cut.add(images)
            progress(cut.segment, cut.done)
    return entry


class _Cut:
    """One clip in the making."""

    def __init__(self, session: RecordedSession, segment: Segment, folder: ClipFolder) -> None:
        self.segment = segment
        self.wanted_ns = instants(segment, session.video.fps)
        self._session, self._video = session, session.video
        self._path = folder.file(segment.phase, session.name)
        self._writer: ClipWriter | None = None
        self._added = 0

    @property
    def done(self) -> float:
        """How much of it is there [0..1]."""
        return self._added / len(self.wanted_ns)

    def add(self, images: Mapping[str, Image]) -> None:
        """The next picture; after the last one the clip is finished."""
        video = self._video
        if len(images) < len(video.views):
            raise LogError(f"{self._session.folder}: a view's pictures begin too late to be cut")
        if self._writer is None:
            width, height = len(video.views) * video.width, video.height + STRIP_HEIGHT
            self._writer = ClipWriter(self._path, width, height, video.fps)
        self._writer.add(side_by_side(images, video.views, self.segment.phase.value))
        self._added += 1
        if self._added == len(self.wanted_ns):
            self._writer.finish()

    def close(self) -> None:
        """Give it up if it is not finished."""
        if self._writer is not None:
            self._writer.close()


def _entry(session: RecordedSession, selection: Selection, context_s: float) -> CutSession:
    header = session.log.header
    recorded_s = (header.started_ns + header.wall_offset_ns) / NS_PER_S
    return CutSession(
        recorded=datetime.fromtimestamp(recorded_s, UTC).isoformat(timespec="milliseconds"),
        picture=session.picture,
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

"""Recorded sessions as clips are cut from them: which phase was when, and each view's frames.

Lossless captures are taken where the session kept some; else the bitstream of the log is decoded.
"""

from __future__ import annotations

import heapq
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pydantic import ValidationError

from tams_app.config import VideoConfig
from tams_app.config.problems import describe_validation_error
from tams_app.config.whole import without_removed
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, UnreadableLogError
from tams_app.recording import LOG_NAME, SessionLog, read_log, read_reference, read_video
from tams_app.records import Frame, Phase, PhaseChange
from tams_app.session.recorders import REFERENCE_NAME
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.colour import bgr_of
from tams_app.video.live.recorded import decoded


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
        raise UnreadableLogError(f"{folder}: tells no phases; give another session")
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

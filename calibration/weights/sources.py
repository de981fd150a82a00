"""Recorded sessions as clips are cut from them: which phase was when, and each view's pictures.

Lossless captures are taken where the session kept some; else the bitstream of the log is decoded.
"""

from __future__ import annotations

import heapq
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from calibration.weights.decoding import Picture, decode
from calibration.weights.segments import Segment, phase_segments
from tams_app import gst
from tams_app.config.problems import describe_validation_error
from tams_app.config.streaming import VideoConfig
from tams_app.errors import ConfigError, LogError
from tams_app.recording import SessionLog, read_log, read_reference, read_video
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S
from tams_app.session.recorders import LOG_NAME, REFERENCE_NAME

_GAP_NS = 500 * NS_PER_MS  # what a busy recorder may leave out


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """One session folder; its name tells it from others."""

    folder: Path
    log: SessionLog
    video: VideoConfig

    @property
    def name(self) -> str:
        return self.folder.name

    @property
    def has_captures(self) -> bool:
        """Whether the pictures are there as the cameras gave them."""
        return (self.folder / REFERENCE_NAME).is_file()

    @property
    def is_of_rig(self) -> bool:
        """Whether it shows the simulated rig."""
        return bool(self.log.header.config.get("rig", {}).get("enabled", False))

    @property
    def picture(self) -> str:
        """What a rater sees, in words."""
        if self.has_captures:
            return "lossless captures"
        network = self.log.header.network
        return "as sent, no bottleneck" if network == "none" else f"as sent over {network}"

    @property
    def is_constrained(self) -> bool:
        """Whether the pictures suffered from a narrow uplink, which the paper's did not."""
        return not self.has_captures and self.log.header.network != "none"

    def segments(self, context_s: float = 0.0) -> list[Segment]:
        """Its phases, each with `context_s` before and after, as far as every view has pictures.

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
                raise LogError(f"{self.folder}: has no pictures of {view}; give another session")
        first_ns = max(min(captured) for captured in times.values())
        return first_ns, min(max(captured) for captured in times.values())

    def pictures(self) -> Generator[Picture]:
        """All views' pictures in the order of their captures.

        LogError at their end if that comes before the session's: a full disk ends the lossless
        captures before the log, and a still picture must not pass for the rest.
        """
        newest_ns = dict.fromkeys(self.video.views, 0)
        with ExitStack() as stack:
            views = [stack.enter_context(closing(self._view(view))) for view in self.video.views]
            for picture in heapq.merge(*views, key=lambda picture: picture.capture_ns):
                newest_ns[picture.view] = picture.capture_ns
                yield picture
        _, last_ns = self._span_ns
        for view, end_ns in newest_ns.items():
            if end_ns < last_ns - _GAP_NS:
                missing_s = (last_ns - end_ns) / NS_PER_S
                raise LogError(
                    f"{self.folder}: the last {missing_s:.1f} s have no pictures of {view}: give "
                    f"another session too, or move {REFERENCE_NAME} away to cut what was sent"
                )

    def _view(self, view: str) -> Generator[Picture]:
        if self.has_captures:
            offset_ns = self.log.header.wall_offset_ns
            for frame in read_reference(self.folder / REFERENCE_NAME, offset_ns):
                if frame.view == view:
                    yield Picture(view, frame.capture_ns, frame.image)
            return
        decoder = gst.choose_decoder(self.video.decoder)
        yield from decode(read_video(self.folder / LOG_NAME, view), self.video, decoder)


def open_session(given: Path, views: Sequence[str]) -> RecordedSession:
    """The session in the folder `given`, or whose log that is; ConfigError or LogError if not."""
    folder = given.parent if given.name == LOG_NAME else given
    if not (folder / LOG_NAME).is_file():
        raise ConfigError(f"--from {given}: is no session: give a folder that holds {LOG_NAME}")
    folder = folder.resolve()
    log = read_log(folder / LOG_NAME)
    if set(log.header.views) != set(views):
        raise ConfigError(
            f"{folder}: shows the views {', '.join(log.header.views)}, the configuration has "
            f"{', '.join(views)}: give a session of this set-up"
        )
    if not log.phases:
        raise LogError(f"{folder}: tells no phases; give another session")
    kept = log.header.config.get("recording", {}).get("bitstream", True)
    if not kept and not (folder / REFERENCE_NAME).is_file():
        raise LogError(f"{folder}: was recorded without pictures; set recording.bitstream: true")
    return RecordedSession(folder, log, _video(folder, log, views))


def _video(folder: Path, log: SessionLog, views: Sequence[str]) -> VideoConfig:
    """How the pictures were made, the views in the order of the configuration."""
    made = log.header.config.get("video", {})
    try:
        return VideoConfig.model_validate({**made, "views": tuple(views)})
    except ValidationError as error:
        raise LogError(
            f"{folder}: was recorded by another version of TAMS: video."
            f"{describe_validation_error(error)}; give another session"
        ) from error

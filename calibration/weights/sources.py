"""Recorded sessions as clips are cut from them: which phase was when, and each view's pictures.

Lossless captures are taken where the session kept some; else the bitstream of the log is decoded.
"""

from __future__ import annotations

import heapq
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from calibration.weights.decoding import Picture, decode
from calibration.weights.segments import Segment, phase_segments
from tams_app import gst
from tams_app.config.streaming import VideoConfig
from tams_app.errors import ConfigError, LogError
from tams_app.recording import SessionLog, read_log, read_reference, read_video
from tams_app.session.recorders import LOG_NAME, REFERENCE_NAME


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
        times = {
            view: [frame.capture_ns for frame in self.log.sent if frame.view == view]
            for view in self.video.views
        }
        for view, captured in times.items():
            if not captured:
                raise LogError(f"{self.folder}: has no pictures of {view}; give another session")
        first_ns = max(min(captured) for captured in times.values())
        last_ns = min(max(captured) for captured in times.values())
        return phase_segments(self.log.phases, first_ns, last_ns, context_s)

    def pictures(self) -> Generator[Picture]:
        """All views' pictures in the order of their captures."""
        with ExitStack() as stack:
            views = [stack.enter_context(closing(self._view(view))) for view in self.video.views]
            yield from heapq.merge(*views, key=lambda picture: picture.capture_ns)

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
    video = VideoConfig.model_validate({**log.header.config["video"], "views": tuple(views)})
    return RecordedSession(folder, log, video)

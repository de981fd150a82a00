"""A run that replayed a recorded hand, and the stretch of it that is compared with other runs.

The hand's time counts from its first reading, which is the first tick of the control loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tams_app.policy.weights import WeightMatrix
from tams_app.recording import SessionLog, read_log, read_video
from tams_app.records import Phase
from tams_app.summary.tables import Span


@dataclass(frozen=True, slots=True)
class Replay:
    """One run's log, and the stretch of it that counts."""

    log: SessionLog
    path: Path
    span: Span

    @property
    def hand_began_ns(self) -> int:
        return self.log.ticks[0].started_ns

    def inside(self, t_ns: int) -> bool:
        return self.span.start_ns <= t_ns < self.span.end_ns

    def primary_view(self, t_ns: int) -> str:
        """The view with the largest weight in the phase at `t_ns`."""
        phases = [one.phase for one in self.log.phases if one.t_ns <= t_ns] or [Phase.REACH]
        return WeightMatrix(self.log.header.weights).primary_view(phases[-1])


def read_replays(paths: Sequence[Path], squeeze_ns: int, end_ns: int) -> list[Replay]:
    """The logs at `paths` from the hand's first squeeze to where the first of them ends."""
    logs = [read_log(path) for path in paths]
    lasts = [log.captured[-1].capture_ns - log.ticks[0].started_ns for log in logs]
    end_ns = min([end_ns, *lasts])
    return [
        Replay(log, path, Span(began_ns + squeeze_ns, began_ns + end_ns))
        for log, path in zip(logs, paths, strict=True)
        for began_ns in [log.ticks[0].started_ns]
    ]


def first_frames(replay: Replay) -> dict[str, tuple[int, bytes]]:
    """Index and bytes of the first encoded frame of each view."""
    found = {}
    for view in replay.log.header.views:
        for frame in read_video(replay.path, view):
            found[view] = (frame.index, frame.data)
            break
    return found

"""Which stretches of a session become clips: the longest of each phase. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from tams_app.records import Phase, PhaseChange
from tams_app.runtime.clock import NS_PER_S

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


@dataclass(frozen=True, slots=True)
class Selection:
    """What to cut from a session, and how much of it was left out, in segments."""

    chosen: tuple[Segment, ...]  # in the order of Phase, at most one each
    too_short: int
    not_longest: int


def phase_segments(
    changes: Sequence[PhaseChange], first_ns: int, last_ns: int, context_s: float = 0.0
) -> list[Segment]:
    """The stretches between phase changes as far as they lie within [first_ns, last_ns].

    Each begins `context_s` earlier and ends that much later, as far as there are pictures.
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

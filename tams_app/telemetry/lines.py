"""Sentences for people: notes, stops and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from tams_app.recording.topics import OutcomeGiven
from tams_app.records import Note, Outcome, StopRecord
from tams_app.units import NS_PER_MS

Spoken: TypeAlias = Note | StopRecord | OutcomeGiven


@dataclass(frozen=True, slots=True)
class Line:
    """A sentence with its time, level (info, warning, error) and kind (note, stop, outcome)."""

    t_ns: int
    level: str
    kind: str
    text: str


def line_of(record: Spoken) -> Line:
    """The sentence that a record amounts to; a stop that was not the operator's is an error."""
    if isinstance(record, Note):
        return Line(record.t_ns, record.level, "note", record.text)
    if isinstance(record, OutcomeGiven):
        return Line(record.t_ns, "info", "outcome", _sentence(record.outcome))
    if record.stopped_ns is None:
        how = "the session ended before the arm was seen at rest"
    else:
        how = f"at rest after {(record.stopped_ns - record.visible_ns) / NS_PER_MS:.0f} ms"
    return Line(record.visible_ns, "error", "stop", f"stop, {record.reason}: {how}")


def _sentence(outcome: Outcome) -> str:
    if outcome.completed is None:
        return f"not judged: {outcome.reason}"
    if outcome.success is None:  # as the operator's side alone knows it
        return f"{'placed' if outcome.completed else 'not placed'}: {outcome.reason}"
    if not outcome.completed:
        return f"not completed, {outcome.drops} drops: {outcome.reason}"
    verdict = "a success" if outcome.success else "no success"
    return (
        f"completed in {outcome.completion_time_s:.1f} s, {outcome.drops} drops, "
        f"{verdict}: {outcome.reason}"
    )

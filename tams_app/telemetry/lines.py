"""Sentences for Foxglove's log panel: notes, stops and the verdict."""

from __future__ import annotations

from foxglove import Context
from foxglove.channels import LogChannel
from foxglove.messages import Log, LogLevel

from tams_app.recording.topics import OutcomeGiven
from tams_app.records import Note, Outcome, StopRecord
from tams_app.telemetry.messages import timestamp
from tams_app.units import NS_PER_MS

_LEVELS = {"info": LogLevel.Info, "warning": LogLevel.Warning, "error": LogLevel.Error}


class LogLines:
    """Sends them on `/log`."""

    def __init__(self, context: Context, offset_ns: int) -> None:
        """`offset_ns`: from the session's clock to that of the wall."""
        self._channel = LogChannel("/log", context=context)
        self._offset_ns = offset_ns

    def on_note(self, note: Note) -> None:
        self._send(note.t_ns, _LEVELS.get(note.level, LogLevel.Unknown), "note", note.text)

    def on_stop(self, stop: StopRecord) -> None:
        """A stop that was not the operator's release, as an error."""
        if stop.stopped_ns is None:
            how = "the session ended before the arm was seen at rest"
        else:
            how = f"at rest after {(stop.stopped_ns - stop.visible_ns) / NS_PER_MS:.0f} ms"
        self._send(stop.visible_ns, LogLevel.Error, "stop", f"stop, {stop.reason}: {how}")

    def on_outcome(self, given: OutcomeGiven) -> None:
        self._send(given.t_ns, LogLevel.Info, "outcome", _sentence(given.outcome))

    def _send(self, t_ns: int, level: LogLevel, name: str, text: str) -> None:
        wall_ns = t_ns + self._offset_ns
        line = Log(timestamp=timestamp(wall_ns), level=level, name=name, message=text)
        self._channel.log(line, log_time=wall_ns)


def _sentence(outcome: Outcome) -> str:
    if outcome.completed is None:
        return f"not judged: {outcome.reason}"
    if not outcome.completed:
        return f"not completed, {outcome.drops} drops: {outcome.reason}"
    verdict = "a success" if outcome.success else "no success"
    return (
        f"completed in {outcome.completion_time_s:.1f} s, {outcome.drops} drops, "
        f"{verdict}: {outcome.reason}"
    )

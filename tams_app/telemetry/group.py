"""Several viewers of one session."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tams_app.recording import Header, Viewers
from tams_app.telemetry.rates import RatesMeter


class ViewerGroup:
    """Satisfies `tams_app.recording.Viewers`: each gets every record, and `Rates` each second."""

    def __init__(self, header: Header, viewers: Sequence[Viewers]) -> None:
        self._viewers = tuple(viewers)
        self._meter = RatesMeter(header.views, header.started_ns)

    def receive(self, record: Any, now_ns: int) -> None:
        """A record that the log keeps, or a frame shown that was wanted."""
        self._send(record, now_ns)
        self._meter.receive(record)
        if (rates := self._meter.take(now_ns)) is not None:
            self._send(rates, now_ns)

    def wants(self, view: str, shown_ns: int) -> bool:
        """True if any of them wants a frame shown now with its pixels."""
        wanted = [viewer.wants(view, shown_ns) for viewer in self._viewers]  # all keep their pace
        return any(wanted)

    def close(self) -> None:
        """The log ends; may be called twice."""
        for viewer in self._viewers:
            viewer.close()

    def _send(self, record: Any, now_ns: int) -> None:
        for viewer in self._viewers:
            viewer.receive(record, now_ns)

"""What the log asks of the channels for viewers that are derived from it (`tams_app.telemetry`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

from foxglove import Context

from tams_app.recording.topics import Header


class Viewers(Protocol):
    """Channels beside the log's own, in the same file."""

    def receive(self, record: Any, now_ns: int) -> None:
        """A record that the log keeps, an encoded frame, or a frame shown that was wanted."""

    def wants(self, view: str, shown_ns: int) -> bool:
        """Whether a frame shown now is wanted with its pixels; each view in one thread."""

    def close(self) -> None:
        """The log ends; may be called twice."""


MakeViewers: TypeAlias = Callable[[Context, Header], Viewers]

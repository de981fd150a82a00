"""What the parts of a session record in its log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from tams_app.recording.topics import Facts
from tams_app.records import Note, PacketRecord, Record
from tams_app.runtime.clock import Clock


class Log(Protocol):
    """Keeps records; a frame's pixels are let go."""

    def record(self, item: Record) -> None:
        """Keep one record."""

    def record_packets(self, packets: Sequence[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""


class Journal:
    """Records, sentences and facts of one session, live and in virtual time; from any thread."""

    def __init__(
        self, clock: Clock, log: Log, show: Callable[[str], None] = lambda _text: None
    ) -> None:
        """`show` gets the text of each note, too."""
        self._clock = clock
        self._log = log
        self._show = show

    def record(self, item: Record) -> None:
        """Keep one record in the log, and show it if it is a sentence."""
        if isinstance(item, Note):
            self._show(item.text)
        self._log.record(item)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence for people; `level` is info, warning or error."""
        self.record(Note(self._clock.now_ns(), level, text))

    def fact(self, name: str, value: str) -> None:
        """Keep something that was learned after the start; a later value of the name counts."""
        self._log.record(Facts(self._clock.now_ns(), {name: value}))

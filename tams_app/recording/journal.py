"""What the parts of a session record in its log, and have at hand of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.recording.reference import ReferenceRecorder
from tams_app.recording.topics import Facts
from tams_app.records import Frame, LinkCapacity, Newest, Note, PacketRecord, Record
from tams_app.runtime.clock import Clock


class Log(Protocol):
    """Keeps records; a frame's pixels are let go."""

    def record(self, item: Record) -> None:
        """Keep one record."""

    def record_packets(self, packets: Sequence[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""


class Journal:
    """Records, sentences and facts of one session, live and in virtual time; from any thread.

    `newest`: the newest record of each type.
    """

    def __init__(
        self,
        clock: Clock,
        log: Log,
        show: Callable[[str], None] = lambda _text: None,
        reference: ReferenceRecorder | None = None,
    ) -> None:
        """`show` gets the text of each note, too, `reference` each captured frame."""
        self._clock = clock
        self._log = log
        self._show = show
        self._reference = reference
        self.newest = Newest()
        self._last_capacity_kbps: float | None = None
        self._capacity_ns = clock.now_ns()

    def record(self, item: Record) -> None:
        """Keep one record, have it at hand as the newest of its type, and show a sentence."""
        self.newest.put(item)
        if isinstance(item, Note):
            self._show(item.text)
        self._log.record(item)

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""
        self._log.record_packets(packets)

    def capture(self, frame: Frame) -> None:
        """Keep a captured frame's time, and its pixels if that was asked for."""
        self._log.record(frame)
        if self._reference is not None:
            self._reference.record(frame)

    def capacity(self, now_ns: int, capacity: Capacity) -> None:
        """Keep what the link has truly carried since the last call, when that has changed."""
        kbps = capacity.mean_kbps(self._capacity_ns, now_ns)
        self._capacity_ns = now_ns
        if kbps != self._last_capacity_kbps:
            self._last_capacity_kbps = kbps
            self.record(LinkCapacity(now_ns, kbps))

    def note(self, level: str, text: str) -> None:
        """Keep a sentence for people; `level` is info, warning or error."""
        self.record(Note(self._clock.now_ns(), level, text))

    def fact(self, name: str, value: str) -> None:
        """Keep something that was learned after the start; a later value of the name counts."""
        self._log.record(Facts(self._clock.now_ns(), {name: value}))

"""The robot side's records in the log: each step, each frame captured, the link's load."""

from __future__ import annotations

from collections.abc import Callable

from tams_app.capacity import Capacity
from tams_app.recording import ReferenceRecorder
from tams_app.recording.journal import Journal, Log
from tams_app.records import (
    Frame,
    LinkCapacity,
    Newest,
    PacketRecord,
    Record,
)
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock


class SessionRecords(Journal, Listener):
    """The journal of a session, which gets its steps; live (`Recorders`) and in virtual time."""

    def __init__(
        self,
        clock: Clock,
        log: Log,
        reference: ReferenceRecorder | None = None,
        show: Callable[[str], None] = lambda _text: None,
    ) -> None:
        """`show` gets the text of each note, too."""
        super().__init__(clock, log, show)
        self._reference = reference
        self.newest = Newest()
        self._last_capacity_kbps: float | None = None
        self._capacity_ns = clock.now_ns()

    def record(self, item: Record) -> None:
        """Keep one record, have it at hand as the newest of its type, and show a sentence."""
        self.newest.put(item)
        super().record(item)

    def packets(self, packets: list[PacketRecord]) -> None:
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

    def receive(self, record: Record) -> None:
        self.record(record)

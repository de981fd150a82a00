"""What the parts of a session record in its log, and have at hand of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from tams_app.capacity import Capacity
from tams_app.recording.reference import ReferenceRecorder
from tams_app.recording.topics import Facts
from tams_app.records import Frame, LinkCapacity, Newest, Note, PacketRecord, Record
from tams_app.runtime.clock import Clock


class Journal(ABC):
    """Records, sentences and facts of one session; what writes its log derives from it.

    `newest`: the newest record of each type.
    """

    def __init__(self, clock: Clock, show: Callable[[str], None] = lambda _text: None) -> None:
        """`show` gets the text of each note, too."""
        self._clock = clock
        self._show = show
        self.reference: ReferenceRecorder | None = None  # gets each captured frame, too
        self.newest = Newest()
        self._last_capacity_kbps: float | None = None
        self._capacity_ns = clock.now_ns()

    def record(self, item: Record) -> None:
        """Keep one record, have it at hand as the newest of its type, and show a sentence."""
        self.newest.put(item)
        if isinstance(item, Note):
            self._show(item.text)
        self.keep(item)

    @abstractmethod
    def keep(self, item: Record) -> None:
        """Keep one record in the log; a frame's pixels are let go."""

    @abstractmethod
    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Keep the fates of a batch of datagrams."""

    def capture(self, frame: Frame) -> None:
        """Keep a captured frame's time, and its pixels if that was asked for."""
        self.keep(frame)
        if self.reference is not None:
            self.reference.record(frame)

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
        self.keep(Facts(self._clock.now_ns(), {name: value}))

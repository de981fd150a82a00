"""What all views of one run have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tams_app.errors import TamsError
from tams_app.records import DroppedFrame, EncodedFrame, PacketRecord, ShownFrame
from tams_app.video.link import Link
from tams_app.video.virtual_time.event_queue import EventQueue
from tams_app.video.virtual_time.idle import Rest
from tams_app.video.virtual_time.stepped_clock import SteppedClock


@dataclass(frozen=True, slots=True)
class VideoRecords:
    """Where the events of all views go; called in the thread that advances, in order of time."""

    encoded: Callable[[EncodedFrame], None]
    dropped: Callable[[DroppedFrame], None]
    shown: Callable[[ShownFrame], None]
    packets: Callable[[list[PacketRecord]], None]


@dataclass(frozen=True, slots=True)
class ProcessingTimes:
    """How long encoder and decoder take in virtual time [ns]; live: `make bench`, medians."""

    encoding_ns: int = 4_500_000
    decoding_ns: int = 2_500_000


@dataclass(frozen=True, slots=True)
class Shared:
    """The one link, the one clock, and what is due."""

    link: Link
    events: EventQueue
    clock: SteppedClock
    rest: Rest
    records: VideoRecords
    times: ProcessingTimes


class LaterClock:
    """The stepped clock as read when a processor's work of `later_ns` is done."""

    def __init__(self, clock: SteppedClock, later_ns: int = 0) -> None:
        self._clock = clock
        self.later_ns = later_ns

    def now_ns(self) -> int:
        return self._clock.now_ns() + self.later_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        raise TamsError("a chain in virtual time must not sleep")

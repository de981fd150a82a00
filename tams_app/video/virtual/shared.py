"""The parts that all views of one run in virtual time share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tams_app.records import DroppedFrame, EncodedFrame, PacketRecord, ShownFrame
from tams_app.video.core.link import Link
from tams_app.video.virtual.event_queue import EventQueue
from tams_app.video.virtual.rtcp_sessions import Feedback
from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.wait_idle import IdleGate

# What encoder and decoder take in virtual time; live: `make bench`, medians.
ENCODING_NS, DECODING_NS = 4_500_000, 2_500_000


@dataclass(frozen=True, slots=True)
class VideoRecords:
    """Receivers of all views' events; called in the advancing thread, in order of time."""

    encoded: Callable[[EncodedFrame], None]
    dropped: Callable[[DroppedFrame], None]
    shown: Callable[[ShownFrame], None]
    packets: Callable[[list[PacketRecord]], None]
    # of a view: what its receiver asks for, and when that arrives [ns]
    feedback: Callable[[str, Feedback, int], None] = lambda _view, _feedback, _arrives_ns: None


@dataclass(frozen=True, slots=True)
class Shared:
    """The one link, the one clock, and the queue of events."""

    link: Link
    events: EventQueue
    clock: SteppedClock
    idle_gate: IdleGate
    records: VideoRecords

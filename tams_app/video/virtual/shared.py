"""The parts that all views of one run in virtual time share, and what a run gives out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

from tams_app.records import DroppedFrame, EncodedFrame, PacketRecord, ShownFrame
from tams_app.video.core.link import Link
from tams_app.video.virtual.stepped_clock import EventQueue, SteppedClock
from tams_app.video.virtual.wait_idle import IdleGate

# What encoder and decoder take in virtual time; live: `make bench`, medians.
ENCODING_NS, DECODING_NS = 4_500_000, 2_500_000


VideoRecord: TypeAlias = EncodedFrame | DroppedFrame | ShownFrame | PacketRecord


@dataclass(frozen=True, slots=True)
class Shared:
    """The one link, the one clock, the queue of events, and what has happened by now.

    records: of all views, in the order of time, until they are taken.
    """

    link: Link
    events: EventQueue
    clock: SteppedClock
    idle_gate: IdleGate
    records: list[VideoRecord] = field(default_factory=list)

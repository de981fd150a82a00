"""What a session log holds: its header, its topics, and the records only a log has.

Adding a record means adding one line to `TOPICS` and one list to `SessionLog` (reader.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from tams_app.recording.codec import Codec
from tams_app.records import (
    Allocation,
    DroppedFrame,
    EncodedFrame,
    Frame,
    FrameQuality,
    LinkCapacity,
    Note,
    OperatorGlance,
    Outcome,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    SceneTruth,
    ShownFrame,
    StopRecord,
    SystemSample,
    Tick,
)

SCHEMA = 1
PROFILE = "tams-session"  # the MCAP header's profile, by which a reader knows our logs
REFERENCE_PROFILE = "tams-reference"

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Header:
    """What is known when the session starts; the first message of every log.

    `wall_offset_ns` + any `*_ns` of the log = nanoseconds since 1970 (UTC).
    `weights`: the phase weights that define the primary view, whatever the strategy.
    """

    version: str
    name: str
    seed: int
    strategy: str
    network: str
    budget_mode: str
    servo: str
    control_rate_hz: float
    views: tuple[str, ...]
    fps: int
    weights: dict[Phase, dict[str, float]]
    started_ns: int
    wall_offset_ns: int
    config: dict[str, Any]  # the effective configuration
    schema: int = SCHEMA


@dataclass(frozen=True, slots=True)
class Facts:
    """What was learned after the start and belongs to the header: name to value."""

    t_ns: int
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class FrameCaptured:
    """A camera's frame, without its pixels."""

    view: str
    index: int
    capture_ns: int


@dataclass(frozen=True, slots=True)
class FrameSent:
    """An encoded frame, without its bytes; those follow on the view's video topic."""

    view: str
    index: int
    capture_ns: int
    encoded_ns: int
    keyframe: bool
    size_bytes: int
    pushed_ns: int = 0


@dataclass(frozen=True, slots=True)
class FrameShown:
    """A decoded frame that reached the mailbox, without its pixels."""

    view: str
    index: int
    shown_ns: int


@dataclass(frozen=True, slots=True)
class OutcomeGiven:
    """The verdict and when it was given."""

    t_ns: int
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class PacketBatch:
    """`PacketRecord`s as columns of equal length; kind and fate by number."""

    view: tuple[str, ...]
    kind: tuple[int, ...]
    sequence: tuple[int, ...]
    size_bytes: tuple[int, ...]
    entered_ns: tuple[int, ...]
    departed_ns: tuple[int, ...]
    delivered_ns: tuple[int, ...]
    fate: tuple[int, ...]
    rtp_timestamp: tuple[int, ...]

    @staticmethod
    def of(packets: Sequence[PacketRecord]) -> PacketBatch:
        return PacketBatch(
            view=tuple(packet.view for packet in packets),
            kind=tuple(packet.kind.value for packet in packets),
            sequence=tuple(packet.sequence for packet in packets),
            size_bytes=tuple(packet.size_bytes for packet in packets),
            entered_ns=tuple(packet.entered_ns for packet in packets),
            departed_ns=tuple(packet.departed_ns for packet in packets),
            delivered_ns=tuple(packet.delivered_ns for packet in packets),
            fate=tuple(packet.fate.value for packet in packets),
            rtp_timestamp=tuple(packet.rtp_timestamp for packet in packets),
        )

    def packets(self) -> list[PacketRecord]:
        kinds = [_KINDS[number] for number in self.kind]
        fates = [_FATES[number] for number in self.fate]
        return list(
            map(
                PacketRecord,
                self.view,
                kinds,
                self.sequence,
                self.size_bytes,
                self.entered_ns,
                self.departed_ns,
                self.delivered_ns,
                fates,
                self.rtp_timestamp,
            )
        )


_KINDS = {kind.value: kind for kind in PacketKind}
_FATES = {fate.value: fate for fate in PacketFate}

# What a recorder accepts; pixels are never kept, only when they were captured and shown.
Recordable: TypeAlias = (
    Tick
    | PhaseChange
    | Allocation
    | LinkCapacity
    | Frame
    | EncodedFrame
    | DroppedFrame
    | ShownFrame
    | FrameQuality
    | PacketRecord
    | StopRecord
    | Note
    | SystemSample
    | SceneTruth
    | OperatorGlance
    | Outcome
    | Facts
)


class Topic(Generic[T]):
    """Where records of one type go, and the instant each stands for."""

    def __init__(self, name: str, record_type: type[T], time_ns: Callable[[T], int]) -> None:
        self.name = name
        self.codec = Codec(record_type)
        self.time_ns = time_ns


HEADER = Topic("/header", Header, lambda header: header.started_ns)

TOPICS: dict[type, Topic[Any]] = {
    topic.codec.record_type: topic
    for topic in (
        HEADER,
        Topic("/facts", Facts, lambda record: record.t_ns),
        Topic("/tick", Tick, lambda record: record.started_ns),
        Topic("/phase", PhaseChange, lambda record: record.t_ns),
        Topic("/allocation", Allocation, lambda record: record.t_ns),
        Topic("/capacity", LinkCapacity, lambda record: record.t_ns),
        Topic("/frames/captured", FrameCaptured, lambda record: record.capture_ns),
        Topic("/frames/sent", FrameSent, lambda record: record.encoded_ns),
        Topic("/frames/dropped", DroppedFrame, lambda record: record.capture_ns),
        Topic("/frames/shown", FrameShown, lambda record: record.shown_ns),
        Topic("/frames/quality", FrameQuality, lambda record: record.capture_ns),
        Topic("/packets", PacketBatch, lambda record: max(record.entered_ns)),
        Topic("/stop", StopRecord, lambda record: record.visible_ns),
        Topic("/note", Note, lambda record: record.t_ns),
        Topic("/system", SystemSample, lambda record: record.t_ns),
        Topic("/scene", SceneTruth, lambda record: record.t_ns),
        Topic("/operator/glance", OperatorGlance, lambda record: record.t_ns),
        Topic("/outcome", OutcomeGiven, lambda record: record.t_ns),
    )
}


VIDEO_PREFIX = "/video/"  # + view: foxglove.CompressedVideo
REFERENCE_PREFIX = "/reference/"  # + view: foxglove.RawImage, in the reference log
TRANSFORMS = "/tf"  # foxglove.FrameTransform of TCP, block and container, for 3-D viewers

"""What a session log holds: its header, its topics, and the records only a log has.

Adding a record means adding one line to `TOPICS` and one list to `SessionLog` (reader.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, Generic, TypeAlias, TypeVar

from tams_app.recording.codec import Codec
from tams_app.records import (
    Allocation,
    CameraRates,
    DroppedFrame,
    EncodedFrame,
    Frame,
    FrameQuality,
    HandHeard,
    LinkCapacity,
    LinkHealth,
    Note,
    OperatorGlance,
    Outcome,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    PolicyInputs,
    SceneTruth,
    ShownFrame,
    StateHeard,
    StopRecord,
    SystemSample,
    Tick,
    UplinkSummary,
)

# Schema 1: the arm's state in numbers, `damaged` frames; `codec` upgrades them.
# Up to schema 2 an RTP timestamp told the index: n · 90000 / fps.
# Up to schema 3 `/cameras` was called `/rates`, which is a channel for viewers since.
SCHEMA = 4
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
    rtp_timestamp: int | None = None

    @staticmethod
    def of(frame: EncodedFrame) -> FrameSent:
        return FrameSent(
            frame.view,
            frame.index,
            frame.capture_ns,
            frame.encoded_ns,
            frame.keyframe,
            len(frame.data),
            frame.pushed_ns,
            frame.rtp_timestamp,
        )

    def with_data(self, data: bytes) -> EncodedFrame:
        """The frame again, with its bytes."""
        return EncodedFrame(
            self.view,
            self.index,
            self.capture_ns,
            self.encoded_ns,
            self.keyframe,
            data,
            self.pushed_ns,
            self.rtp_timestamp,
        )


@dataclass(frozen=True, slots=True)
class FrameShown:
    """A decoded frame that reached the mailbox, without its pixels."""

    view: str
    index: int
    shown_ns: int
    whole: bool | None = None  # None: the log does not say


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
        """The columns of at least one packet."""
        return PacketBatch(*zip(*map(_COLUMNS, packets), strict=True))

    def packets(self) -> list[PacketRecord]:
        """The packets one by one."""
        columns = [getattr(self, field.name) for field in fields(self)]
        columns[1] = map(_KINDS.__getitem__, self.kind)
        columns[7] = map(_FATES.__getitem__, self.fate)
        return list(map(PacketRecord, *columns))


_OF_AN_ENUM = {"kind": "kind._value_", "fate": "fate._value_"}  # `value` is a call each
_COLUMNS = attrgetter(*(_OF_AN_ENUM.get(one.name, one.name) for one in fields(PacketBatch)))
_KINDS = {kind.value: kind for kind in PacketKind}
_FATES = {fate.value: fate for fate in PacketFate}

# What a recorder accepts; pixels are never kept, only when they were captured and shown.
Recordable: TypeAlias = (
    Tick
    | PhaseChange
    | Allocation
    | LinkCapacity
    | UplinkSummary
    | PolicyInputs
    | CameraRates
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
    | HandHeard
    | StateHeard
    | LinkHealth
    | Outcome
    | Facts
)


class Topic(Generic[T]):
    """Where records of one type go, and the instant each stands for.

    `records` names the list of a `SessionLog` that they are read back into, if there is one.
    """

    def __init__(
        self, name: str, record_type: type[T], time_ns: Callable[[T], int], records: str = ""
    ) -> None:
        self.name = name
        self.codec = Codec(record_type)
        self.time_ns = time_ns
        self.records = records


HEADER = Topic("/header", Header, lambda header: header.started_ns)

TOPICS: dict[type, Topic[Any]] = {
    topic.codec.record_type: topic
    for topic in (
        HEADER,
        Topic("/facts", Facts, lambda one: one.t_ns),
        Topic("/tick", Tick, lambda one: one.started_ns, "ticks"),
        Topic("/phase", PhaseChange, lambda one: one.t_ns, "phases"),
        Topic("/allocation", Allocation, lambda one: one.t_ns, "allocations"),
        Topic("/capacity", LinkCapacity, lambda one: one.t_ns, "capacities"),
        Topic("/uplink", UplinkSummary, lambda one: one.t_ns, "uplink"),
        Topic("/policy/inputs", PolicyInputs, lambda one: one.t_ns, "policy_inputs"),
        Topic("/cameras", CameraRates, lambda one: one.t_ns, "rates"),
        Topic("/frames/captured", FrameCaptured, lambda one: one.capture_ns, "captured"),
        Topic("/frames/sent", FrameSent, lambda one: one.encoded_ns, "sent"),
        Topic("/frames/dropped", DroppedFrame, lambda one: one.capture_ns, "dropped"),
        Topic("/frames/shown", FrameShown, lambda one: one.shown_ns, "shown"),
        Topic("/frames/quality", FrameQuality, lambda one: one.capture_ns, "quality"),
        Topic("/packets", PacketBatch, lambda one: max(one.entered_ns)),
        Topic("/stop", StopRecord, lambda one: one.visible_ns, "stops"),
        Topic("/note", Note, lambda one: one.t_ns, "notes"),
        Topic("/system", SystemSample, lambda one: one.t_ns, "system"),
        Topic("/scene", SceneTruth, lambda one: one.t_ns, "scene"),
        Topic("/operator/glance", OperatorGlance, lambda one: one.t_ns, "glances"),
        Topic("/link/hand", HandHeard, lambda one: one.t_ns, "hands_heard"),
        Topic("/link/state", StateHeard, lambda one: one.t_ns, "states_heard"),
        Topic("/link/health", LinkHealth, lambda one: one.t_ns, "link_health"),
        Topic("/outcome", OutcomeGiven, lambda one: one.t_ns),
    )
}


LOG_NAME = "session.mcap"  # in a session's folder
FORMER_NAMES = {"/rates": "/cameras"}  # of topics, up to schema 3

PICTURE_PREFIX = "/shown/"  # + view: foxglove.CompressedImage
VIDEO_PREFIX = "/video/"  # + view: foxglove.CompressedVideo
REFERENCE_PREFIX = "/reference/"  # + view: foxglove.RawImage, in the reference log

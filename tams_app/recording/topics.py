"""What a session log holds: its header, its topics, and the records only a log has.

Adding a record means adding one line to `SessionLog`.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Annotated, Any, TypeVar

from tams_app.recording.codec import Codec
from tams_app.records import (
    Allocation,
    CameraRates,
    CaptureNs,
    DroppedFrame,
    EncodedFrame,
    Episode,
    FrameIndex,
    FrameQuality,
    HandHeard,
    LinkCapacity,
    LinkHealth,
    MountPrediction,
    Note,
    OperatorGlance,
    Outcome,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
    Placed,
    PolicyInputs,
    Record,
    SceneTruth,
    StateHeard,
    StopRecord,
    SystemSample,
    Tick,
    TimeNs,
    UplinkSummary,
    ViewName,
)
from tams_app.units import NS_PER_S

SCHEMA = 4  # of the logs that are written and read
PROFILE = "tams-session"  # the MCAP header's profile, by which a reader knows our logs
REFERENCE_PROFILE = "tams-reference"

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Header:
    """What is known when the session starts; the first message of every log."""

    version: Annotated[str, "of TAMS"]
    name: Annotated[str, "of the session"]
    seed: Annotated[int, "of scene, noise and losses"]
    strategy: Annotated[str, "how the budget is divided"]
    network: Annotated[str, "the emulated uplink"]
    budget_mode: Annotated[str, "where the capacity comes from: oracle, sender or feedback"]
    servo: Annotated[
        str,
        "servo mode: velocity; pose: a session up to version 2 that led the arm from pose to pose",
    ]
    control_rate_hz: Annotated[float, "ticks of the control loop [1/s]"]
    views: Annotated[tuple[str, ...], "names of the views"]
    fps: Annotated[int, "frames that each camera is asked for [1/s]"]
    weights: Annotated[
        dict[Phase, dict[str, float]],
        "the matrix W: share of each view in each phase, rows sum to 1; defines the primary view "
        "whatever the strategy",
    ]
    started_ns: Annotated[int, "when the session began [ns]"]
    wall_offset_ns: Annotated[
        int, "added to any other *_ns it gives nanoseconds since 1970, UTC [ns]"
    ]
    config: Annotated[dict[str, Any], "the effective configuration"]
    schema: Annotated[int, "version of this log's format"] = SCHEMA


@dataclass(frozen=True, slots=True)
class Facts(Record):
    """What was learned after the start and belongs to the header."""

    t_ns: TimeNs
    values: Annotated[
        dict[str, str],
        "facts by their names, such as `encoder`; of a trial with people `drops_counted` and "
        "`placed_marked`",
    ]


@dataclass(frozen=True, slots=True)
class FrameCaptured(Record):
    """A camera's frame, without its pixels."""

    view: ViewName
    index: FrameIndex
    capture_ns: CaptureNs


@dataclass(frozen=True, slots=True)
class FrameSent:
    """An encoded frame, without its bytes; those follow on the view's video topic."""

    view: ViewName
    index: FrameIndex
    capture_ns: CaptureNs
    encoded_ns: Annotated[int, "when the encoder had finished the frame [ns]"]
    keyframe: Annotated[bool, "whether decoding can begin here"]
    size_bytes: Annotated[int, "bytes of H.264 [B]"]
    pushed_ns: Annotated[
        int, "when the frame was handed to the sender [ns]; 0: the log does not say"
    ] = 0
    rtp_timestamp: Annotated[
        int | None, "of the frame's packets, 90 kHz; null: the log does not say"
    ] = None
    ready_ns: Annotated[
        int,
        "when the camera, or the rig's renderer, had made the picture [ns]; 0: the log does not "
        "say",
    ] = 0

    @staticmethod
    def of(frame: EncodedFrame) -> FrameSent:
        return FrameSent(size_bytes=len(frame.data), **_shared(frame))

    def with_data(self, data: bytes) -> EncodedFrame:
        """The frame again, with its bytes."""
        return EncodedFrame(data=data, **_shared(self))


def _shared(frame: FrameSent | EncodedFrame) -> dict[str, Any]:
    """What is known of a frame with its bytes and without them."""
    return {name: getattr(frame, name) for name in _SHARED}


_SHARED = [one.name for one in fields(EncodedFrame) if one.name != "data"]


@dataclass(frozen=True, slots=True)
class FrameShown(Record):
    """A decoded frame that reached the mailbox, without its pixels."""

    view: ViewName
    index: FrameIndex
    shown_ns: Annotated[int, "when the decoded frame reached the screen [ns]"]
    whole: Annotated[
        bool | None,
        "whether no packet of it or of what it is predicted from was missing; null: the log does "
        "not say",
    ] = None
    received_ns: Annotated[
        int,
        "when the jitter buffer had handed out the frame's last packet [ns]; 0: the log does not "
        "say",
    ] = 0


@dataclass(frozen=True, slots=True)
class OutcomeGiven:
    """The verdict and when it was given."""

    t_ns: TimeNs
    outcome: Annotated[Outcome, "the verdict"]


@dataclass(frozen=True, slots=True)
class RecordsLost(Record):
    """What the log lacks because its disk was too slow or stood still."""

    since_ns: Annotated[int, "time of the newest record before the loss [ns]"]
    t_ns: Annotated[int, "when the disk was back [ns]"]
    records: Annotated[int, "records that were lost in between"]


@dataclass(frozen=True, slots=True)
class PacketBatch:
    """`PacketRecord`s as columns of equal length; kind and fate by number."""

    view: Annotated[tuple[str, ...], "name of the view"]
    kind: Annotated[tuple[int, ...], "0 media, 1 resent, 2 RTCP, 3 parity, 4 padding"]
    sequence: Annotated[tuple[int, ...], "RTP sequence number; RTCP and padding: 0"]
    size_bytes: Annotated[tuple[int, ...], "IP datagram with its headers [B]"]
    entered_ns: Annotated[tuple[int, ...], "when each datagram reached the uplink [ns]"]
    departed_ns: Annotated[tuple[int, ...], "when each left the bottleneck [ns]; 0: it overflowed"]
    delivered_ns: Annotated[tuple[int, ...], "when each arrived [ns]; 0: it did not"]
    fate: Annotated[tuple[int, ...], "0 delivered, 1 queue overflow, 2 lost"]
    rtp_timestamp: Annotated[tuple[int, ...], "of the frame's packets, 90 kHz; RTCP and padding: 0"]

    @property
    def t_ns(self) -> int:
        """When the last of them reached the uplink [ns]."""
        return max(self.entered_ns)

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


class Topic(Codec[T]):
    """Where records of one type go, their form there, and the instant each stands for."""

    def __init__(self, name: str, record_type: type[T], time: str = "t_ns") -> None:
        """`time`: the field that has it [ns], which must exist."""
        inspect.getattr_static(record_type, time)
        super().__init__(record_type)
        self.name = name
        self.time_ns = attrgetter(time)


def records(name: str, record_type: type[T], time: str = "t_ns") -> list[T]:
    """A field of `SessionLog`: the list of a topic's records; arguments as of `Topic`."""
    return field(default_factory=list, metadata={Topic: Topic(name, record_type, time)})


@dataclass(frozen=True, slots=True)
class Gap:
    """Part of a log that cannot be read: `start_ns` to `end_ns`, None where that is not known."""

    start_ns: int | None
    end_ns: int | None


def damage_sentence(missing: Sequence[tuple[float | None, float | None]]) -> str:
    """What a log lacks; "" if that is nothing.

    missing: from when to when [s since the start], None where that is not known.
    """
    sentences = []
    stretches: list[tuple[float, float]] = []
    for from_s, to_s in sorted(
        (from_s or 0.0, to_s) for from_s, to_s in missing if to_s is not None
    ):
        if stretches and from_s <= stretches[-1][1]:  # chunks that lie over one another
            from_s, before_s = stretches.pop()
            to_s = max(to_s, before_s)
        stretches.append((from_s, to_s))
    if lost := [f"{from_s:.1f} to {to_s:.1f} s" for from_s, to_s in stretches]:
        sentences.append(f"The log is damaged: what was recorded at {', '.join(lost)} is missing.")
    if cut := [from_s for from_s, to_s in missing if to_s is None]:
        sentences.append(
            f"The log ends early, at {cut[0] or 0:.1f} s (the session was killed, the disk was "
            "full, or the file was cut or damaged)."
        )
    return " ".join(sentences)


@dataclass(slots=True)
class SessionLog:
    """All records of one log in the order they were written (not always that of their times).

    `facts` belongs to the header but was learned later; `ended_ns` is the newest time of any
    record; `truncated`: the file has no proper end (the session was killed, or the disk was full);
    `gaps`: where records are missing: they were lost, or bytes of the file have changed since.
    """

    header: Header
    ended_ns: int
    truncated: bool = False
    gaps: list[Gap] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    packets: list[PacketRecord] = field(default_factory=list)
    outcome: Outcome | None = None
    ticks: list[Tick] = records("/tick", Tick, "started_ns")
    phases: list[PhaseChange] = records("/phase", PhaseChange)
    pins: list[PinnedView] = records("/pinned", PinnedView)
    allocations: list[Allocation] = records("/allocation", Allocation)
    capacities: list[LinkCapacity] = records("/capacity", LinkCapacity)
    uplink: list[UplinkSummary] = records("/uplink", UplinkSummary)
    policy_inputs: list[PolicyInputs] = records("/policy/inputs", PolicyInputs)
    rates: list[CameraRates] = records("/cameras", CameraRates)
    captured: list[FrameCaptured] = records("/frames/captured", FrameCaptured, "capture_ns")
    sent: list[FrameSent] = records("/frames/sent", FrameSent, "encoded_ns")
    dropped: list[DroppedFrame] = records("/frames/dropped", DroppedFrame, "capture_ns")
    shown: list[FrameShown] = records("/frames/shown", FrameShown, "shown_ns")
    quality: list[FrameQuality] = records("/frames/quality", FrameQuality, "capture_ns")
    stops: list[StopRecord] = records("/stop", StopRecord, "visible_ns")
    notes: list[Note] = records("/note", Note)
    lost: list[RecordsLost] = records("/lost", RecordsLost)
    system: list[SystemSample] = records("/system", SystemSample)
    scene: list[SceneTruth] = records("/scene", SceneTruth)
    glances: list[OperatorGlance] = records("/operator/glance", OperatorGlance)
    hands_received: list[HandHeard] = records("/link/hand", HandHeard)
    states_received: list[StateHeard] = records("/link/state", StateHeard)
    episodes: list[Episode] = records("/episode", Episode)
    placed: list[Placed] = records("/placed", Placed)
    predictions: list[MountPrediction] = records("/prediction", MountPrediction, "now_ns")
    link_health: list[LinkHealth] = records("/link/health", LinkHealth)

    @property
    def complete(self) -> bool:
        """Whether everything that was written is here."""
        return not self.truncated and not self.gaps

    @property
    def missing(self) -> list[Gap]:
        """From when to when there are no records; an end of None: to the end, wherever it was."""
        return [*self.gaps, *([Gap(self.ended_ns, None)] if self.truncated else [])]

    @property
    def damage(self) -> str:
        """What is missing, as `damage_sentence` says it."""
        return damage_sentence(
            [(self._seconds(gap.start_ns), self._seconds(gap.end_ns)) for gap in self.missing]
        )

    def since_start_s(self, t_ns: int) -> float:
        """A time of the session's clock in seconds since the session started."""
        return (t_ns - self.header.started_ns) / NS_PER_S

    def _seconds(self, t_ns: int | None) -> float | None:
        return None if t_ns is None else self.since_start_s(t_ns)

    @property
    def has_episodes(self) -> bool:
        """Whether the session was divided into episodes, of which none may have ended."""
        recording = self.header.config.get("recording", {})
        return bool(self.episodes or recording.get("episodes"))

    @property
    def judged_episodes(self) -> list[Episode]:
        """Each episode once, by its newest verdict, in order."""
        newest = {episode.number: episode for episode in self.episodes}
        return [newest[number] for number in sorted(newest)]

    def add(self, record: Any) -> None:
        """Put one record where its type belongs."""
        if isinstance(record, PacketBatch):
            self.packets.extend(record.packets())
        elif isinstance(record, OutcomeGiven):
            self.outcome = record.outcome
        elif isinstance(record, Facts):
            self.facts.update(record.values)
        elif not isinstance(record, Header):
            getattr(self, _LISTS[type(record)]).append(record)


HEADER = Topic("/header", Header, "started_ns")
_IN_LISTS: dict[str, Topic[Any]] = {
    one.name: one.metadata[Topic] for one in fields(SessionLog) if Topic in one.metadata
}
_LISTS = {topic.record_type: name for name, topic in _IN_LISTS.items()}
_TOPICS: tuple[Topic[Any], ...] = (
    HEADER,
    Topic("/facts", Facts),
    *_IN_LISTS.values(),
    Topic("/packets", PacketBatch),
    Topic("/outcome", OutcomeGiven),
)
TOPICS = {topic.record_type: topic for topic in _TOPICS}

LOG_NAME = "session.mcap"  # in a session's folder

PICTURE_PREFIX = "/shown/"  # + view: foxglove.CompressedImage
VIDEO_PREFIX = "/video/"  # + view: foxglove.CompressedVideo
REFERENCE_PREFIX = "/reference/"  # + view: foxglove.RawImage, in the reference log

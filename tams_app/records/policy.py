"""What the policy knows of task and uplink, and what it asks of the encoders."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Annotated

from tams_app.records.record import Record, TimeNs, ViewName

IP_UDP_HEADER_BYTES = 28  # IPv4 (20) + UDP (8)


class Phase(StrEnum):
    """The six phases of the pick-and-place task (paper, section II)."""

    REACH = "REACH"
    ALIGN = "ALIGN"
    GRASP = "GRASP"
    TRANSPORT = "TRANSPORT"
    PRE_RELEASE = "PRE_RELEASE"
    RELEASE = "RELEASE"

    @property
    def word(self) -> str:
        """As the paper writes it, such as Pre-release."""
        return self.value.replace("_", "-").capitalize()


@dataclass(frozen=True, slots=True)
class PhaseChange(Record):
    """A phase began."""

    t_ns: TimeNs
    phase: Annotated[Phase, "phase of the task"]
    reason: Annotated[str, "the line of Algorithm 1 that decided"]


@dataclass(frozen=True, slots=True)
class PinnedView(Record):
    """The operator pinned a view: it is the primary one from now on, whatever the phase."""

    t_ns: TimeNs
    view: Annotated[str, 'the view; "": none is pinned any more']


@dataclass(frozen=True, slots=True)
class Allocation(Record):
    """What the policy asked of the encoders at one instant."""

    t_ns: TimeNs
    phase: Annotated[
        Phase,
        "phase whose row of W applied: the task's, or while a view is pinned one in which that is "
        "primary",
    ]
    capacity_kbps: Annotated[float, "what the uplink is believed to carry [kbit/s of IP datagrams]"]
    budget_kbps: Annotated[
        float, "B: the capacity after the safety factor [kbit/s of IP datagrams]"
    ]
    target_kbps: Annotated[
        dict[str, int],
        "target of each view [kbit/s of IP datagrams]; the sum never exceeds B",
    ]


class PacketKind(Enum):
    """What an uplink datagram carried."""

    MEDIA = 0
    REPAIR = 1
    RTCP = 2
    PARITY = 3
    PADDING = 4


class PacketFate(Enum):
    """What became of a datagram at the link."""

    DELIVERED = 0
    OVERFLOW = 1  # tail drop at the bottleneck queue
    LOST = 2


@dataclass(frozen=True, slots=True)
class PacketRecord(Record):
    """One datagram's way through the link; `size_bytes` includes IP and UDP headers."""

    view: str
    kind: PacketKind
    # RTP sequence of the media packet carried; REPAIR: the original's; PARITY: that of the first
    # packet protected; RTCP, PADDING: 0
    sequence: int
    size_bytes: int
    entered_ns: int
    departed_ns: int  # left the bottleneck; 0 if it overflowed
    delivered_ns: int  # 0 if it was not delivered
    fate: PacketFate
    rtp_timestamp: int = 0  # 90 kHz, that of its `EncodedFrame`; 0 for RTCP and padding


@dataclass(frozen=True, slots=True)
class PacketArrival:
    """What a receiver reported of one packet of the RTP flow."""

    view: str
    sent_ns: int  # entered the uplink, on the sender's clock
    size_bytes: int  # IP datagram
    arrived_ns: int | None  # on the receiver's clock, of unknown offset; None: it did not arrive


@dataclass(frozen=True, slots=True)
class Reception:
    """A report block of a receiver (RFC 3550, 6.4.1)."""

    view: ViewName
    fraction_lost: Annotated[float, "share of packets lost since the report before"]
    round_trip_ns: Annotated[int | None, "as the receiver reports it [ns]; null: not known yet"]
    jitter_ns: Annotated[int, "interarrival jitter (RFC 3550) [ns]"]


@dataclass(frozen=True, slots=True)
class UplinkReport:
    """What the senders know of the uplink at one instant.

    `arrivals` and `receptions` came since the report before; arrivals are those of all views in the
    order of sending, each packet once. Each view's receiver reports when a frame has come: packets
    of one view may be reported after later ones of another, in the next report. What is reported in
    feedback that does not come is reported no more.
    """

    now_ns: int
    sent_bytes: int  # IP datagrams of all views since the start, repair and padding included
    arrivals: tuple[PacketArrival, ...] = ()
    receptions: tuple[Reception, ...] = ()


@dataclass(frozen=True, slots=True)
class PolicyInputs(Record):
    """All that one step of the policy received: an `UplinkReport`, its arrivals as columns."""

    t_ns: TimeNs
    sent_bytes: Annotated[int, "IP datagrams of all views since the start [B]"]
    receptions: Annotated[tuple[Reception, ...], "report blocks of receivers (RFC 3550)"]
    view: Annotated[tuple[str, ...], "of each packet that receivers reported"]
    sent_ns: Annotated[tuple[int, ...], "when each entered the uplink [ns]"]
    size_bytes: Annotated[tuple[int, ...], "of each, IP datagram with its headers [B]"]
    arrived_ns: Annotated[
        tuple[int | None, ...], "when each arrived, on the receiver's clock [ns]; null: it did not"
    ]

    @staticmethod
    def of(report: UplinkReport) -> PolicyInputs:
        """What `report` contains."""
        arrivals = report.arrivals
        return PolicyInputs(
            report.now_ns,
            report.sent_bytes,
            report.receptions,
            tuple(one.view for one in arrivals),
            tuple(one.sent_ns for one in arrivals),
            tuple(one.size_bytes for one in arrivals),
            tuple(one.arrived_ns for one in arrivals),
        )

    def report(self) -> UplinkReport:
        """The report as it was."""
        columns = zip(self.view, self.sent_ns, self.size_bytes, self.arrived_ns, strict=True)
        arrivals = tuple(PacketArrival(*one) for one in columns)
        return UplinkReport(self.t_ns, self.sent_bytes, arrivals, self.receptions)


@dataclass(frozen=True, slots=True)
class UplinkSummary(Record):
    """What one `UplinkReport` gave the budget, all views together, as the log keeps it."""

    t_ns: TimeNs
    sent_bytes: Annotated[int, "IP datagrams of all views since the start [B]"]
    packets: Annotated[int, "that receivers reported since the step before"]
    lost: Annotated[int, "of these, those that did not arrive"]
    arrived_bytes: Annotated[int, "IP datagrams that arrived, as receivers report [B]"]
    newest_sent_ns: Annotated[
        int | None, "when the last datagram that arrived was sent [ns]; null: none arrived"
    ]
    queueing_ns: Annotated[
        int | None,
        "how much longer that one took than the fastest so far [ns]; null: none arrived",
    ]
    fraction_lost: Annotated[
        dict[str, float],
        "by view, share of packets lost since the step before; `sender` only",
    ]
    round_trip_ns: Annotated[
        dict[str, int | None],
        "by view, as receivers report it [ns]; null: not known yet; `sender` only",
    ]


@dataclass(frozen=True, slots=True)
class LinkCapacity(Record):
    """What the uplink truly carries from `t_ns` on; infinite where there is no bottleneck."""

    t_ns: TimeNs
    capacity_kbps: Annotated[
        float, "what the uplink carries [kbit/s of IP datagrams]; null: no bottleneck"
    ]

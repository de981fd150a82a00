"""Packets on the uplink, and what receivers tell of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

IP_UDP_HEADER_BYTES = 28  # IPv4 (20) + UDP (8)


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
class PacketRecord:
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
    """What a receiver told of one packet of the RTP flow."""

    view: str
    sent_ns: int  # entered the uplink, on the sender's clock
    size_bytes: int  # IP datagram
    arrived_ns: int | None  # on the receiver's clock, of unknown offset; None: it did not arrive


@dataclass(frozen=True, slots=True)
class Reception:
    """A report block of a receiver (RFC 3550, 6.4.1)."""

    view: str
    fraction_lost: float  # since the report before
    round_trip_ns: int | None  # None: not known yet
    jitter_ns: int


@dataclass(frozen=True, slots=True)
class UplinkReport:
    """What the senders know of the uplink at one instant.

    `arrivals` and `receptions` came since the report before; arrivals are those of all views in the
    order of sending, each packet once. Each view's receiver tells when a frame has come: packets of
    one view may be told after later ones of another, in the next report. What is told in feedback
    that does not come is told no more.
    """

    now_ns: int
    sent_bytes: int  # IP datagrams of all views since the start, repair and padding included
    arrivals: tuple[PacketArrival, ...] = ()
    receptions: tuple[Reception, ...] = ()


@dataclass(frozen=True, slots=True)
class PolicyInputs:
    """All that one step of the policy was told: an `UplinkReport`, its arrivals as columns."""

    t_ns: int
    sent_bytes: int
    receptions: tuple[Reception, ...]
    view: tuple[str, ...]
    sent_ns: tuple[int, ...]
    size_bytes: tuple[int, ...]
    arrived_ns: tuple[int | None, ...]

    @staticmethod
    def of(report: UplinkReport) -> PolicyInputs:
        """What `report` tells."""
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
class UplinkSummary:
    """What one `UplinkReport` told the budget, all views together, as the log keeps it."""

    t_ns: int
    sent_bytes: int  # since the start
    packets: int  # that receivers told of
    lost: int  # of these
    arrived_bytes: int
    # of the packet sent last of those that arrived: sent_ns, and how much longer than the
    # fastest so far it took; None: none arrived
    newest_sent_ns: int | None
    queueing_ns: int | None
    fraction_lost: dict[str, float]  # by view, of the receptions
    round_trip_ns: dict[str, int | None]


@dataclass(frozen=True, slots=True)
class LinkCapacity:
    """What the uplink truly carries from `t_ns` on; infinite where there is no bottleneck."""

    t_ns: int
    capacity_kbps: float

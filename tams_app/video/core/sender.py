"""A view's sender without pipeline, socket and clock: what is encoded, at which rate, and sent how.

Live and in virtual time the same object decides; what moves it hands in times and bytes, and takes
out frames to encode, records and packets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import IP_UDP_HEADER_BYTES, DroppedFrame, EncodedFrame, Frame
from tams_app.units import NS_PER_S
from tams_app.video.core.frame_identity import SentFrame, SentFrames
from tams_app.video.core.pacer import FlightBound, Pacer
from tams_app.video.core.packets import Padding, padding_ssrc
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.rate_control import EncoderServo, FrameIntervals, SourceDrop
from tams_app.video.core.rtcp import ReceivedFeedback


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """How one view is encoded and sent.

    rtx: packets are kept to be sent again (`RepairRule.rtx`). start_kbps: the target until the
    first is set; below source_drop_below_kbps whole frames are dropped.
    """

    view: str
    config: VideoConfig
    rtx: bool
    start_kbps: float
    source_drop_below_kbps: float


@dataclass(frozen=True, slots=True)
class Uplink:
    """What the senders of all views share.

    Attributes:
        received: by view, gets what its receiver reports; others are not asked.
        feedback: packets are numbered, and receivers report when each came: both must agree.
        parity: protects the frames of these views, where `RepairRule.parity` lets it.
        flight: asked before a packet is sent again, where `feedback`; None: it always may be.
        pacer: says when the packets of each frame leave; None: at once.
    """

    received: Mapping[str, ReceivedFeedback] = field(default_factory=dict)
    feedback: bool = False
    parity: Mapping[str, ViewParity] = field(default_factory=dict)
    flight: FlightBound | None = None
    pacer: Pacer | None = None


@dataclass(frozen=True, slots=True)
class AdmittedFrame:
    """When a frame is in the stream [ns], and the encoder's `bitrate` for it [kbit/s]."""

    pts_ns: int
    duration_ns: int
    encoder_kbps: int


class Sender:
    """Decides about one view's frames and packets.

    `admit` and `padding` each from one thread, `encoded` and `protect` from the encoder's,
    `set_target_kbps` and `may_retransmit` from any. `sent`: what the stream's timestamps stand for.
    """

    def __init__(self, stream: StreamSettings, uplink: Uplink) -> None:
        self.stream, self.uplink = stream, uplink
        self.view, config = stream.view, stream.config
        self.sent = SentFrames()
        self.received = uplink.received.get(self.view)
        self.parity = uplink.parity.get(self.view)
        self._mtu_bytes = config.mtu_bytes
        self._padding = Padding(padding_ssrc(config, self.view), config.mtu_bytes)
        self._padded_bytes = 0
        self._target_kbps = stream.start_kbps
        self._source_drop = SourceDrop(stream.source_drop_below_kbps)
        first_ns = NS_PER_S // config.fps
        self._intervals = FrameIntervals(first_ns)
        self._servo = EncoderServo(config.mtu_bytes)
        frame_kbps = self._source_drop.frame_target_kbps(stream.start_kbps, first_ns)
        self.first_encoder_kbps = round(self._servo.encoder_kbps(frame_kbps, first_ns))

    def set_target_kbps(self, kbps: float) -> None:
        """The wire rate to meet from the next frame on: IP datagrams, repair included."""
        self._target_kbps = kbps

    def admit(
        self, frame: Frame, wire_bytes: int, now_ns: int, left_out: bool = False
    ) -> AdmittedFrame | DroppedFrame:
        """Whether `frame` is encoded, and how: not if `left_out` or its target cannot pay for it.

        `wire_bytes`: IP datagram bytes that have left so far, repair and padding included.
        """
        target_kbps = self._target_kbps
        time = self._intervals.step(frame.capture_ns)
        kept = not left_out and self._source_drop.keep(target_kbps, time.usual_ns)
        if not kept:
            return DroppedFrame(frame.view, frame.index, frame.capture_ns, left_out)
        frame_kbps = self._source_drop.frame_target_kbps(target_kbps, time.usual_ns)
        encoder_kbps = self._servo.step(wire_bytes - self._padded_bytes, frame_kbps, time)
        if self.parity is not None:
            self.parity.captured(frame.image)
        sent = SentFrame(frame.index, frame.capture_ns, now_ns, frame.ready_ns)
        return AdmittedFrame(self.sent.add(sent), time.usual_ns, encoder_kbps)

    def encoded(self, now_ns: int, timestamp: int, keyframe: bool, data: bytes) -> EncodedFrame:
        """The record of what the encoder has made of an admitted frame.

        TamsError if no frame with this RTP timestamp was admitted.
        """
        sent = self.sent.find(timestamp)
        if sent is None:
            raise TamsError(f"the encoder returned timestamp {timestamp}, which was never pushed")
        return EncodedFrame(
            self.view,
            sent.index,
            sent.capture_ns,
            now_ns,
            keyframe,
            data,
            sent.pushed_ns,
            timestamp,
            sent.ready_ns,
        )

    def protect(self, packets: Sequence[bytes]) -> list[bytes]:
        """The parity packets to send behind the packets of one frame."""
        return [] if self.parity is None else self.parity.protect(packets)

    def padding(self, size_bytes: int, wire_bytes: int) -> Iterator[bytes]:
        """Packets to send beside the frames, which the target does not pay for.

        None before the first frame has left, nor without feedback, which numbers them. Each counts
        when it is taken: send it at once.
        """
        if not self.uplink.feedback or not wire_bytes:
            return
        for packet in self._padding.packets(size_bytes):
            self._padded_bytes += len(packet) + IP_UDP_HEADER_BYTES
            yield packet

    def may_retransmit(self) -> bool:
        """True if a packet may be sent again without exceeding the bound on what is in flight."""
        flight = self.uplink.flight
        return flight is None or flight.admits_retransmission(self._mtu_bytes)

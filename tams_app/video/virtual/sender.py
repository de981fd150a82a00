"""A view's sending side in virtual time: encoder, what was sent, and RTCP's answers to it.

A push into the chain returns when the encoder has encoded. The encoder is x264 whatever the
configuration says: others answer from threads of their own.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from functools import partial
from random import Random

from tams_app import gst
from tams_app.errors import TamsError
from tams_app.records import (
    IP_UDP_HEADER_BYTES,
    DroppedFrame,
    EncodedFrame,
    Frame,
    PacketFate,
    PacketKind,
)
from tams_app.video.core import pipelines
from tams_app.video.core.packets import SEQUENCES, identify, with_transport_sequence
from tams_app.video.core.rtcp import ReceivedFeedback
from tams_app.video.core.sender import AdmittedFrame, Sender
from tams_app.video.live.view_codecs import ViewEncoder
from tams_app.video.virtual.receiver import VirtualReceiver
from tams_app.video.virtual.rtcp_sessions import Feedback, SenderSession
from tams_app.video.virtual.shared import ENCODING_NS, Shared
from tams_app.video.virtual.stepped_clock import Chain, LaterClock, SteppedClock

_ORIGINAL_SEQUENCE_BYTES = 2  # what RTX adds to a packet (RFC 4588)


class EncoderChain(Chain):
    """Frames in, RTP packets out, one after the other; an appsink hands them out."""

    def __init__(self, sender: Sender, clock: SteppedClock) -> None:
        stream, feedback = sender.stream, sender.uplink.feedback
        description = (
            f"{pipelines.encoder_chain(stream, sender.first_encoder_kbps, feedback)} "
            "! appsink name=packets async=false sync=false"
        )
        super().__init__(description, "converter", clock, f"the sender of view {stream.view}")
        self._packets = self.pipeline["packets"]
        self._requests = self.pipeline["payloader"].get_static_pad("src")
        self._encoded: list[EncodedFrame] = []
        done_clock = LaterClock(clock, ENCODING_NS)
        self._encoder = ViewEncoder(sender, self.pipeline, done_clock, self._encoded.append)
        self.play(pipelines.raw_caps(stream.config))

    def encode(
        self, frame: Frame, admitted: AdmittedFrame
    ) -> tuple[list[EncodedFrame], list[bytes]]:
        """The record and the packets of a frame; TamsError if nothing comes of it."""
        self.push(self._encoder.buffer(frame, admitted))
        buffers = gst.pull_available(self._packets)
        packets = [each.extract_dup(0, each.get_size()) for each in buffers]
        if self.pipeline.failure or not packets:
            reason = self.pipeline.failure or f"nothing came of frame {frame.index}"
            raise TamsError(f"{self.pipeline.what} failed: {reason}")
        encoded = self._encoded.copy()
        self._encoded.clear()
        return encoded, packets

    def request_keyframe(self) -> None:
        """Make the next frame a keyframe, as rtpsession does when a PLI comes."""
        modules = gst.load()
        self._requests.send_event(
            modules.GstVideo.video_event_new_upstream_force_key_unit(
                modules.Gst.CLOCK_TIME_NONE, False, 0
            )
        )


class SentPackets:
    """The packets that rtprtxsend keeps: media of the last `history_ms`, by sequence number."""

    def __init__(self, history_ms: int) -> None:
        self._history_ticks = 90 * history_ms
        self._packets: dict[int, bytes] = {}
        self._order: deque[tuple[int, int]] = deque()  # (RTP timestamp, sequence number)

    def keep(self, sequence: int, timestamp: int, packet: bytes) -> None:
        self._packets[sequence] = packet
        self._order.append((timestamp, sequence))
        while timestamp - self._order[0][0] > self._history_ticks:
            del self._packets[self._order.popleft()[1]]

    def find(self, sequence: int) -> bytes | None:
        """The packet with this number; None if it is forgotten."""
        return self._packets.get(sequence)


class VirtualSender:
    """Encodes and sends one view into the shared link, at whose end is `receiver`."""

    def __init__(
        self, sender: Sender, seed: int, shared: Shared, receiver: VirtualReceiver
    ) -> None:
        stream = sender.stream
        self.view = stream.view
        self.wire_bytes = 0
        self._sender, self._receiver, self._shared = sender, receiver, shared
        self._feedback = sender.uplink.feedback
        self._pacer = sender.uplink.pacer
        self._next_sequence = 0  # transport-wide
        self._unreported: deque[tuple[int, int, int]] = deque()  # number, sent_ns, bytes
        self._history = SentPackets(pipelines.RTX_HISTORY_MS) if stream.rtx else None
        self._session = SenderSession(Random(f"{seed}/{self.view}/sender-rtcp"), stream.rtx)
        self._chain = EncoderChain(sender, shared.clock)
        self.close = self._chain.close
        self.timing = self._session.timing  # it knows when `step` must be called
        self.set_target_kbps = sender.set_target_kbps

    def push(self, frame: Frame, left_out: bool = False) -> None:
        """Encode `frame` now; its packets enter the link when the encoder has had its time."""
        now_ns = self._shared.clock.now_ns()
        admitted = self._sender.admit(frame, self.wire_bytes, now_ns, left_out)
        if isinstance(admitted, DroppedFrame):
            self._shared.records.append(admitted)
            return
        encoded, packets = self._chain.encode(frame, admitted)
        self._shared.records.extend(encoded)
        self._shared.events.post(now_ns + ENCODING_NS, partial(self._send, packets))

    def pad(self, size_bytes: int) -> None:
        """Send so much beside the frames now, as live."""
        for packet in self._sender.padding(size_bytes, self.wire_bytes):
            self._offer(PacketKind.PADDING, packet, 0, 0)

    def step(self) -> None:
        """Send the reports that are due now."""
        now_ns = self._shared.clock.now_ns()
        for size_bytes in self._session.step(now_ns):
            link, events = self._shared.link, self._shared.events
            record = link.offer(now_ns, self.view, PacketKind.RTCP, size_bytes, 0)
            self._shared.records.append(record)
            if record.fate is PacketFate.DELIVERED:
                transit_ns = record.delivered_ns - now_ns
                arrive = partial(self._receiver.arrive_report, transit_ns, size_bytes)
                events.post(record.delivered_ns, arrive)

    def obey(self, feedback: Feedback) -> None:
        """Feedback has come: receive it, force a keyframe, send packets again."""
        now_ns = self._shared.clock.now_ns()
        keyframe = self._session.received(now_ns, feedback)
        if self._sender.received is not None:
            self._receive(now_ns, feedback, self._sender.received)
        if keyframe:
            self._chain.request_keyframe()
        for sequence in feedback.nacks:
            self._retransmit(sequence)

    def _receive(self, now_ns: int, feedback: Feedback, received: ReceivedFeedback) -> None:
        if feedback.block is not None and not self._feedback:  # as live
            round_trip_ns = self._session.round_trip_ns or None
            received.blocks([replace(feedback.block, round_trip_ns=round_trip_ns)])
        for message in feedback.arrivals:
            reported = [self._unreported.popleft()]
            while reported[-1][0] != message.last:
                reported.append(self._unreported.popleft())
            received.report(now_ns, reported, message.arrived_ns)

    def _send(self, packets: list[bytes]) -> None:
        """The packets of a frame, parity behind them, when the pacer lets them leave."""
        packets = [*packets, *self._sender.protect(packets)]
        if self._pacer is None:
            self._enter(packets)
            return
        sizes_bytes = [len(packet) + IP_UDP_HEADER_BYTES for packet in packets]
        for leaves_ns, part in self._pacer.schedule(self._shared.clock.now_ns(), sizes_bytes):
            self._shared.events.post(leaves_ns, partial(self._enter, packets[part]))

    def _enter(self, packets: list[bytes]) -> None:
        for packet in packets:
            kind, sequence, timestamp = identify(packet)
            if self._history is not None and kind is PacketKind.MEDIA:
                self._history.keep(sequence, timestamp, packet)
            self._offer(kind, packet, sequence, timestamp)

    def _retransmit(self, sequence: int) -> None:
        packet = self._history.find(sequence) if self._history is not None else None
        if packet is None or (self._feedback and not self._sender.may_retransmit()):
            return
        self._offer(PacketKind.REPAIR, packet, sequence, identify(packet)[2])

    def _offer(self, kind: PacketKind, packet: bytes, sequence: int, timestamp: int) -> None:
        resent = kind is PacketKind.REPAIR
        now_ns = self._shared.clock.now_ns()
        size_bytes = len(packet) + IP_UDP_HEADER_BYTES + resent * _ORIGINAL_SEQUENCE_BYTES
        self.wire_bytes += size_bytes
        self._session.sent(now_ns, kind)
        if self._feedback:
            packet = with_transport_sequence(packet, self._next_sequence)
            self._unreported.append((self._next_sequence, now_ns, size_bytes))
            self._next_sequence = (self._next_sequence + 1) % SEQUENCES
        record = self._shared.link.offer(now_ns, self.view, kind, size_bytes, sequence, timestamp)
        self._shared.records.append(record)
        if record.fate is PacketFate.DELIVERED:
            arrive = partial(self._receiver.arrive, packet, resent)
            self._shared.events.post(record.delivered_ns, arrive)

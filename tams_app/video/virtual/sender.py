"""A view's sending side in virtual time: encoder, what was sent, and RTCP's answers to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from random import Random

from tams_app.errors import TamsError
from tams_app.records import IP_UDP_HEADER_BYTES, Frame, PacketFate, PacketKind, PacketRecord
from tams_app.video.core.packets import (
    SEQUENCES,
    Padding,
    identify,
    padding_ssrc,
    with_transport_sequence,
)
from tams_app.video.core.pipelines import RTX_HISTORY_MS
from tams_app.video.core.received_feedback import ReceivedFeedback, Uplink
from tams_app.video.core.stream import StreamSettings
from tams_app.video.live.view_encoder import ViewEncoder
from tams_app.video.virtual.chains import EncoderChain
from tams_app.video.virtual.rtcp_sessions import Feedback, SenderSession, SentPackets
from tams_app.video.virtual.shared import ENCODING_NS, Shared
from tams_app.video.virtual.stepped_clock import LaterClock

_ORIGINAL_SEQUENCE_BYTES = 2  # what RTX adds to a packet (RFC 4588)


class VirtualSender:
    """Encodes and sends one view into the shared link.

    `deliver(packet, resent)` is called when a packet arrives, `deliver_report(transit_ns, bytes)`
    when a sender report does.
    """

    def __init__(
        self,
        stream: StreamSettings,
        seed: int,
        shared: Shared,
        deliver: Callable[[bytes, bool], None],
        deliver_report: Callable[[int, int], None],
        uplink: Uplink,
    ) -> None:
        self.view = view = stream.view
        config = stream.config
        self.wire_bytes = 0
        self._padding = Padding(padding_ssrc(config, view), config.mtu_bytes)
        self._padded_bytes = 0
        self._shared = shared
        self._deliver = deliver
        self._deliver_report = deliver_report
        self._received = uplink.received.get(view)
        self._feedback = uplink.feedback
        self._may_resend = partial(uplink.may_resend, config.mtu_bytes)
        self._pacer = uplink.pacer
        self._next_sequence = 0  # transport-wide
        self._unreported: deque[tuple[int, int, int]] = deque()  # number, sent_ns, bytes
        self._parity = uplink.parity.get(view)
        self._history = SentPackets(RTX_HISTORY_MS) if stream.rtx else None
        self._session = SenderSession(Random(f"{seed}/{view}/sender-rtcp"), stream.rtx)
        self._done_clock = LaterClock(shared.clock)
        records = shared.records
        self._frames = ViewEncoder(stream, self._done_clock, records.encoded, records.dropped)
        self.sent = self._frames.sent
        self._chain = EncoderChain(stream, self._frames, shared.clock, uplink.feedback)
        self.start, self.close = self._chain.start, self._chain.close
        self.timing = self._session.timing  # it knows when `step` must be called
        self.set_target_kbps = self._frames.set_target_kbps

    def push(self, frame: Frame, left_out: bool = False) -> None:
        """Encode `frame` now; its packets enter the link when the encoder has had its time."""
        buffer = self._frames.admit(frame, self.wire_bytes - self._padded_bytes, left_out)
        if buffer is None:
            return
        if self._parity is not None:
            self._parity.captured(frame.image)
        self._done_clock.later_ns = ENCODING_NS
        packets = self._chain.encode(buffer)
        self._done_clock.later_ns = 0
        if self._frames.failure or not packets:
            reason = self._frames.failure or f"nothing came of frame {frame.index}"
            raise TamsError(f"the sender of view {self.view} failed: {reason}")
        done_ns = self._shared.clock.now_ns() + ENCODING_NS
        self._shared.events.post(done_ns, partial(self._send, packets))

    def pad(self, size_bytes: int) -> None:
        """Send so much beside the frames now, as live."""
        if not self._feedback or not self.wire_bytes:
            return
        before = self.wire_bytes
        packets = self._padding.packets(size_bytes)
        records = [self._offer(PacketKind.PADDING, packet, 0, 0) for packet in packets]
        self._padded_bytes += self.wire_bytes - before
        self._shared.records.packets(records)

    def step(self) -> None:
        """Send the reports that are due now."""
        now_ns = self._shared.clock.now_ns()
        for size_bytes in self._session.step(now_ns):
            link, events = self._shared.link, self._shared.events
            record = link.offer(now_ns, self.view, PacketKind.RTCP, size_bytes, 0)
            self._shared.records.packets([record])
            if record.fate is PacketFate.DELIVERED:
                transit_ns = record.delivered_ns - now_ns
                events.post(
                    record.delivered_ns, partial(self._deliver_report, transit_ns, size_bytes)
                )

    def obey(self, feedback: Feedback) -> None:
        """Feedback has come: receive it, force a keyframe, send packets again."""
        now_ns = self._shared.clock.now_ns()
        keyframe = self._session.received(now_ns, feedback)
        if self._received is not None:
            self._receive(now_ns, feedback, self._received)
        if keyframe:
            self._chain.request_keyframe()
        resent = [self._resend(sequence) for sequence in feedback.nacks]
        if found := [record for record in resent if record is not None]:
            self._shared.records.packets(found)

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
        if self._parity is not None:
            packets = [*packets, *self._parity.protect(packets)]
        if self._pacer is None:
            self._enter(packets)
            return
        now_ns = self._shared.clock.now_ns()
        sizes_bytes = [len(packet) + IP_UDP_HEADER_BYTES for packet in packets]
        for part in self._pacer.parts(sizes_bytes):
            leaves_ns = self._pacer.reserve(now_ns, sum(sizes_bytes[part]))
            self._shared.events.post(leaves_ns, partial(self._enter, packets[part]))

    def _enter(self, packets: list[bytes]) -> None:
        records = []
        for packet in packets:
            kind, sequence, timestamp = identify(packet)
            if self._history is not None and kind is PacketKind.MEDIA:
                self._history.keep(sequence, timestamp, packet)
            records.append(self._offer(kind, packet, sequence, timestamp))
        self._shared.records.packets(records)

    def _resend(self, sequence: int) -> PacketRecord | None:
        packet = self._history.find(sequence) if self._history is not None else None
        if packet is None or (self._feedback and not self._may_resend()):
            return None
        return self._offer(PacketKind.REPAIR, packet, sequence, identify(packet)[2])

    def _offer(
        self, kind: PacketKind, packet: bytes, sequence: int, timestamp: int
    ) -> PacketRecord:
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
        if record.fate is PacketFate.DELIVERED:
            deliver = partial(self._deliver, packet, resent)
            self._shared.events.post(record.delivered_ns, deliver)
        return record

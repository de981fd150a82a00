"""A view's receiving side in virtual time: jitter buffer, decoder, and what RTCP asks for."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from random import Random

from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import PacketKind, ShownFrame
from tams_app.video.core.frame_identity import SentFrame
from tams_app.video.core.packets import (
    SEQUENCES,
    RtpHeader,
    media_ssrc,
    read_rtp,
    transport_sequence,
)
from tams_app.video.core.parity import ParityDecoder
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.view_decoder import ViewDecoder
from tams_app.video.virtual.chains import DecoderChain
from tams_app.video.virtual.rtcp_sessions import (
    ArrivalMessages,
    Feedback,
    ReceiverSession,
    StreamStatistics,
)
from tams_app.video.virtual.shared import DECODING_NS, Shared
from tams_app.video.virtual.stepped_clock import LaterClock


class VirtualReceiver:
    """Receives and decodes one view; `return_feedback` is called when its feedback arrives."""

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        seed: int,
        shared: Shared,
        identify: Callable[[int], SentFrame | None],
        return_feedback: Callable[[Feedback], None],
        feedback: bool = False,
    ) -> None:
        self.view = view
        self._shared = shared
        self._return_feedback = return_feedback
        self._expected = 0  # sequence number of the next media packet, if none is lost
        self._parity = ParityDecoder(media_ssrc(config, view)) if rule.parity else None
        self._decoded: list[ShownFrame] = []
        self._arrivals = ArrivalMessages() if feedback else None
        self._statistics = StreamStatistics()
        self._ssrc = media_ssrc(config, view)
        self._session = ReceiverSession(Random(f"{seed}/{view}/receiver-rtcp"), rule.rtx)
        done_clock = LaterClock(shared.clock, DECODING_NS)
        self.decoder = ViewDecoder(view, config, rule, done_clock, identify, self._decoded.append)
        self._chain = DecoderChain(view, rule, self.decoder, shared.clock)
        self.start, self.close = self._chain.start, self._chain.close
        self.timing = self._session.timing  # it knows when `step` must be called
        self.arrive_report = self._session.received_report

    def arrive(self, packet: bytes, resent: bool) -> None:
        now_ns = self._shared.clock.now_ns()
        header = read_rtp(packet)
        kind = PacketKind.MEDIA if header is None else header.kind
        kind = PacketKind.REPAIR if resent else kind
        self._session.received(now_ns, kind)
        parity = kind is PacketKind.PARITY
        if header is not None:
            self._count(now_ns, packet, header, kind)
        if kind is PacketKind.PADDING:
            return
        restored: list[bytes] = []
        if self._parity is not None:
            restored = self._parity.parity(packet) if parity else self._parity.media(packet)
        if not parity:
            in_order = header is not None and not resent and header.sequence == self._expected
            if header is not None and not resent:
                self._expected = (header.sequence + 1) % SEQUENCES
            ends_frame = header is None or header.marker
            self._shared.idle_gate.packet_enters(in_order, ends_frame)
            self._chain.feed(packet, resent)
        for one in restored:
            self._shared.idle_gate.packet_enters(in_order=False, ends_frame=True)
            self._chain.feed(one, resent=False)

    def collect(self) -> None:
        """Take what the chain's threads have left; they are idle now."""
        reason = self.decoder.failure or self._chain.poll()
        if reason:
            raise TamsError(f"the receiver of view {self.view} failed: {reason}")
        now_ns = self._shared.clock.now_ns()
        for sequence, time_left_ms in self._chain.take_nacks():
            self._session.ask_again(now_ns, sequence, time_left_ms)
        if self._chain.take_pli():
            self._session.ask_keyframe(now_ns)
        for shown in self._decoded:
            self._shared.events.post(shown.shown_ns, partial(self._shared.records.shown, shown))
        self._decoded.clear()

    def step(self) -> None:
        """Send the feedback that is due now."""
        take_arrivals = tuple if self._arrivals is None else self._arrivals.take
        block = partial(self._statistics.block, self._ssrc)
        feedback = self._session.step(self._shared.clock.now_ns(), take_arrivals, block)
        if feedback is None:
            return
        due_ns = self._shared.link.feedback(feedback.sent_ns, self.view)
        self._shared.records.feedback(self.view, feedback, due_ns)
        self._shared.events.post(due_ns, partial(self._return_feedback, feedback))

    def _count(self, now_ns: int, packet: bytes, header: RtpHeader, kind: PacketKind) -> None:
        if kind is PacketKind.MEDIA:
            self._statistics.received(now_ns, header)
        if self._arrivals is not None:
            sequence = transport_sequence(packet)
            if self._arrivals.received(now_ns, sequence, header.marker):
                self._session.report_arrivals(now_ns)

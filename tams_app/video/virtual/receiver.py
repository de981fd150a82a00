"""A view's receiving side in virtual time: jitter buffer, decoder, and what RTCP asks for.

A push into the chain returns when the jitter buffer has taken the packet; what its own threads do
with it is awaited by `wait_idle`. The decoder is avdec whatever the configuration says: others
answer from threads of their own.
"""

from __future__ import annotations

from functools import partial
from random import Random
from typing import Any

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import PacketKind, ShownFrame
from tams_app.video.core import pipelines
from tams_app.video.core.frame_identity import Identify
from tams_app.video.core.packets import SEQUENCES, media_ssrc, read_rtp
from tams_app.video.core.parity import ParityDecoder
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.view_codecs import ViewDecoder
from tams_app.video.virtual.rtcp_sessions import Feedback, ReceiverSession
from tams_app.video.virtual.shared import DECODING_NS, Shared
from tams_app.video.virtual.stepped_clock import Chain, LaterClock, SteppedClock


class DecoderChain(Chain):
    """RTP packets in, frames out through a `ViewDecoder`; what it asks for is kept until taken."""

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        identify: Identify,
        clock: SteppedClock,
    ) -> None:
        Gst = gst.load().Gst
        description = f"{pipelines.decoder_chain(rule)} ! {pipelines.SHOWN_FRAMES}"
        super().__init__(description, "jitterbuffer", clock, f"the receiver of view {view}")
        self._clock = clock
        self._nacks: list[tuple[int, int]] = []
        self._plis = 0
        self._decoded: list[ShownFrame] = []
        # live, what leaves the jitter buffer upstream goes to the session
        self.entrance.add_probe(Gst.PadProbeType.EVENT_UPSTREAM, self._on_request)
        self.decoder = ViewDecoder(
            view,
            config,
            rule,
            self.pipeline,
            LaterClock(clock, DECODING_NS),
            identify,
            self._decoded.append,
        )
        self.play(pipelines.rtp_caps())

    def feed(self, packet: bytes, resent: bool) -> None:
        """A packet has arrived; a resent one in its original form, as rtprtxreceive makes it."""
        Gst = gst.load().Gst
        buffer = Gst.Buffer.new_wrapped(packet)
        buffer.dts = self._clock.now_ns() - self._clock.start_ns
        if resent:  # the first flag after GStreamer's own is RTP's mark of a retransmission
            buffer.set_flags(Gst.BufferFlags.LAST)
        self.push(buffer)

    def take_nacks(self) -> list[tuple[int, int]]:
        """Packets to ask for, in order: sequence number and time left to ask [ms]."""
        nacks, self._nacks = sorted(self._nacks), []
        return nacks

    def take_pli(self) -> bool:
        plis, self._plis = self._plis, 0
        return plis > 0

    def take_shown(self) -> list[ShownFrame]:
        """The frames decoded since the last call; TamsError if the chain has failed."""
        if failure := self.pipeline.poll():
            raise TamsError(failure)
        decoded = self._decoded.copy()
        self._decoded.clear()
        return decoded

    def _on_request(self, pad: Any, probe: Any) -> Any:
        modules = gst.load()
        results = modules.Gst.PadProbeReturn
        event = probe.get_event()
        if modules.GstVideo.video_event_is_force_key_unit(event):
            self._plis += 1
            return results.DROP
        structure = event.get_structure()
        if structure is None or structure.get_name() != "GstRTPRetransmissionRequest":
            return results.OK
        self._nacks.append((structure.get_value("seqnum"), time_left_ms(structure)))
        return results.DROP


class VirtualReceiver:
    """Receives and decodes one view, and asks for what it lacks."""

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        seed: int,
        shared: Shared,
        identify: Identify,
        feedback: bool,
    ) -> None:
        """`identify` and `feedback` as for `VideoReceiver`."""
        self._shared = shared
        self._expected = 0  # sequence number of the next media packet, if none is lost
        ssrc = media_ssrc(config, view)
        self._parity = ParityDecoder(ssrc) if rule.parity else None
        random = Random(f"{seed}/{view}/receiver-rtcp")
        self._session = ReceiverSession(random, rule.rtx, ssrc, feedback)
        self._chain = DecoderChain(view, config, rule, identify, shared.clock)
        self.decoder = self._chain.decoder
        self.close = self._chain.close
        self.timing = self._session.timing  # it knows when `step` must be called
        self.arrive_report = self._session.received_report

    def arrive(self, packet: bytes, resent: bool) -> None:
        header = read_rtp(packet)
        kind = PacketKind.MEDIA if header is None else header.kind
        kind = PacketKind.REPAIR if resent else kind
        self._session.received(self._shared.clock.now_ns(), kind, packet, header)
        parity = kind is PacketKind.PARITY
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
        decoded, now_ns = self._chain.take_shown(), self._shared.clock.now_ns()
        for sequence, time_left in self._chain.take_nacks():
            self._session.ask_again(now_ns, sequence, time_left)
        if self._chain.take_pli():
            self._session.ask_keyframe(now_ns)
        for shown in decoded:
            self._shared.events.post(shown.shown_ns, partial(self._shared.records.append, shown))

    def step(self) -> Feedback | None:
        """The feedback that leaves now, if any does."""
        return self._session.step(self._shared.clock.now_ns())


def time_left_ms(request: Any) -> int:
    """Time a request may wait so that the packet still comes in time, as rtpsession reckons."""
    left_ms: int = request.get_value("deadline")
    for name in ("delay", "avg-rtt"):
        spent_ms = request.get_value(name)
        if left_ms > spent_ms:
            left_ms -= spent_ms
        elif name == "avg-rtt":
            left_ms = 0
    return left_ms

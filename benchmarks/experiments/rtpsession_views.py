"""The live chains with their rtpsessions under the stepped clock: what the feedback model is
measured against. Everything but the UDP sockets is as live; slower and optimistic in nothing.

rtpsession waits on the system's clock, so that is replaced for the whole process.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from functools import partial
from typing import Any

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.records import (
    IP_UDP_HEADER_BYTES,
    EncodedFrame,
    Frame,
    PacketFate,
    PacketKind,
    ShownFrame,
)
from tams_app.video.core import pipelines
from tams_app.video.core.link import Link
from tams_app.video.core.packets import identify, media_ssrc
from tams_app.video.core.received_feedback import ReceivedFeedback
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.session_feedback import PacketFeedback
from tams_app.video.live.view_decoder import ViewDecoder, caps_of_payload_type
from tams_app.video.live.view_encoder import ViewEncoder
from tams_app.video.virtual.event_queue import EventQueue
from tams_app.video.virtual.stepped_clock import SteppedClock

_SOURCE = "appsrc name={} is-live=true format=time caps={}"
_SINK = "appsink name={} async=false sync=false"


class RtpSessionView:
    """One view with real sessions on the path that `virtual_time` models."""

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        start_kbps: float,
        link: Link,
        events: EventQueue,
        clock: SteppedClock,
        heard: ReceivedFeedback | None = None,
    ) -> None:
        """`heard` gets what the receiver tells of each packet; None: it does not."""
        self.view = view
        self.counts: Counter[str] = Counter()
        self.shown: list[ShownFrame] = []
        self.report_bytes: Counter[tuple[str, int]] = Counter()
        self._link, self._events, self._clock = link, events, clock
        self._wire_bytes = self._keyframes = 0
        self._frames = ViewEncoder(
            view, config, clock, start_kbps, 80.0, self._count_keyframe, _ignore
        )
        self.decoder = ViewDecoder(
            view, config, rule, clock, self._frames.sent.find, self.shown.append
        )
        self._sender = gst.parse_pipeline(
            pipelines.session_sender(
                config,
                view,
                rule.rtx,
                self._frames.encoder_kbps,
                rtp_out=_SINK.format("rtp_out"),
                reports_out=_SINK.format("reports_out"),
                feedback_in=_SOURCE.format("feedback_in", pipelines.RTCP_CAPS),
                feedback=heard is not None,
            )
        )
        self._receiver = gst.parse_pipeline(
            pipelines.session_receiver(
                config,
                view,
                rule,
                rtp_in=_SOURCE.format("rtp_in", f'"{pipelines.received_caps(heard is not None)}"'),
                reports_in=_SOURCE.format("reports_in", pipelines.RTCP_CAPS),
                feedback_out=_SINK.format("feedback_out"),
            )
        )
        self._configure(config, rule)
        if heard is not None:
            self._listener = PacketFeedback(self._sender.get_by_name("session"), heard, clock)

    def _configure(self, config: VideoConfig, rule: RepairRule) -> None:
        from_string = gst.load().Gst.Structure.from_string
        for pipeline, ssrc in ((self._sender, media_ssrc(config, self.view)), (self._receiver, 7)):
            self._clock.drive(pipeline)
            session = pipeline.get_by_name("session")
            session.set_property("ntp-time-source", 3)  # clock-time
            session.get_property("internal-session").set_property("internal-ssrc", ssrc)
            if rule.rtx:
                payload_types = from_string(pipelines.RTX_PAYLOAD_TYPES)[0]
                pipeline.get_by_name("rtx").set_property("payload-type-map", payload_types)
        if rule.rtx:
            ssrcs = from_string(pipelines.rtx_ssrcs(config, self.view))[0]
            self._sender.get_by_name("rtx").set_property("ssrc-map", ssrcs)
        self._receiver.get_by_name("session").connect("request-pt-map", caps_of_payload_type)
        self._frames.attach(self._sender)
        self.decoder.attach(self._receiver)

    def start(self) -> None:
        """Let both pipelines play.

        Their sessions stay silent until their first packet, as live. Woken before it they send a
        report at once (a session without members has an interval of 0), which meets the first
        frame on the link: its jitter holds that frame up, and the jitter buffer, whose timeouts
        count from the first arrival, waits that much longer to the end of the run.
        """
        gst.set_playing(self._sender, "the sender")
        gst.set_playing(self._receiver, "the receiver")

    def push(self, frame: Frame) -> None:
        buffer = self._frames.admit(frame, self._wire_bytes)
        if buffer is not None:
            self._sender.get_by_name("frames").emit("push-buffer", buffer)

    def set_target_kbps(self, kbps: float) -> None:
        self._frames.set_target_kbps(kbps)

    def close(self) -> None:
        gst.shut_down(self._sender)
        gst.shut_down(self._receiver)

    def collect(self) -> None:
        """Carry what has come out since the last event over the link."""
        now_ns = self._clock.now_ns()
        for datagram in _pull(self._sender, "rtp_out"):
            kind, sequence, timestamp = identify(datagram)
            size_bytes = len(datagram) + IP_UDP_HEADER_BYTES
            self._wire_bytes += size_bytes
            if kind is PacketKind.REPAIR:
                self.counts["repairs_sent"] += 1
                self.counts["repair_bytes"] += size_bytes
            record = self._link.offer(now_ns, self.view, kind, size_bytes, sequence, timestamp)
            if record.fate is PacketFate.DELIVERED:
                self._deliver(record.delivered_ns, self._receiver, "rtp_in", datagram)
        for datagram in _pull(self._sender, "reports_out"):
            size_bytes = len(datagram) + IP_UDP_HEADER_BYTES
            self.report_bytes["sender", size_bytes] += 1
            record = self._link.offer(now_ns, self.view, PacketKind.RTCP, size_bytes, 0)
            if record.fate is PacketFate.DELIVERED:
                self._deliver(record.delivered_ns, self._receiver, "reports_in", datagram)
        for datagram in _pull(self._receiver, "feedback_out"):
            self.report_bytes["receiver", len(datagram) + IP_UDP_HEADER_BYTES] += 1
            asked, plis = _requests(datagram)
            self.counts["nacks_sent"] += asked
            self.counts["plis_sent"] += plis
            due_ns = self._link.feedback(now_ns, self.view)
            self._deliver(due_ns, self._sender, "feedback_in", datagram)
            self._events.post(due_ns, partial(self._count_arrived, asked, plis))

    def keyframes_forced(self) -> int:
        return self._keyframes - 1

    def _count_keyframe(self, encoded: EncodedFrame) -> None:
        self._keyframes += encoded.keyframe

    def _count_arrived(self, asked: int, plis: int) -> None:
        self.counts["nacks_arrived"] += asked
        self.counts["plis_arrived"] += plis

    def _deliver(self, due_ns: int, pipeline: Any, entrance: str, datagram: bytes) -> None:
        self._events.post(due_ns, lambda: self._enter(pipeline, entrance, datagram))

    def _enter(self, pipeline: Any, entrance: str, datagram: bytes) -> None:
        modules = gst.load()
        buffer = modules.Gst.Buffer.new_wrapped_bytes(modules.GLib.Bytes.new(datagram))
        buffer.pts = buffer.dts = self._clock.now_ns() - self._clock.start_ns
        pipeline.get_by_name(entrance).emit("push-buffer", buffer)


def _ignore(_: object) -> None:
    """Nothing of it is measured here."""


def _pull(pipeline: Any, sink: str) -> Iterator[bytes]:
    for buffer in gst.pull_available(pipeline.get_by_name(sink)):
        yield buffer.extract_dup(0, buffer.get_size())


def _requests(compound: bytes) -> tuple[int, int]:
    """Packets asked for by NACK, and PLIs, in one compound RTCP datagram."""
    asked = plis = position = 0
    while position + 4 <= len(compound):
        first, kind, words = struct.unpack_from("!BBH", compound, position)
        end = position + 4 * (words + 1)
        if (kind, first & 0x1F) == (205, 1):
            for entry in range(position + 12, end, 4):
                _, following = struct.unpack_from("!HH", compound, entry)
                asked += 1 + following.bit_count()
        plis += (kind, first & 0x1F) == (206, 1)
        position = end
    return asked, plis

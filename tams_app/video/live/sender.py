"""One view's sender: frames in, H.264 over RTP out, at the rate it was given."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from tams_app import gst
from tams_app.records import IP_UDP_HEADER_BYTES, DroppedFrame, EncodedFrame, Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.pacer import Pacer
from tams_app.video.core.packets import Padding, media_ssrc, padding_ssrc
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.received_feedback import Uplink
from tams_app.video.core.stages import StageMeans
from tams_app.video.core.stream import StreamSettings
from tams_app.video.live.session_feedback import PacketFeedback, ReceptionReports
from tams_app.video.live.udp import (
    UdpSocket,
    ViewPorts,
    requested_ports,
    udp_sink,
    udp_source,
    wire_bytes_sent,
)
from tams_app.video.live.view_encoder import ViewEncoder

# A machine that wakes threads so late has no time for pacing: frames leave at once for a while.
_LATE_NS, _UNPACED_NS = 5 * NS_PER_MS, 5 * NS_PER_S
_LEAVING = 64  # frames: more than the pacer ever holds


class VideoSender:
    """Encodes and sends one view; `push` from one thread, `set_target_kbps` from any.

    Construct, give the receiver's side `feedback_port`, `start`, `push` each frame, `close`. `sent`
    knows what the RTP timestamps of its packets stand for.
    """

    def __init__(
        self,
        stream: StreamSettings,
        clock: Clock,
        on_encoded: Callable[[EncodedFrame], None],
        on_dropped: Callable[[DroppedFrame], None],
        uplink: Uplink,
    ) -> None:
        """Bind the port for feedback; ConfigError if it is taken.

        `on_encoded` and `on_dropped` are those of the `ViewEncoder`. SetupError if GStreamer lacks
        an element.
        """
        gst.require_elements()
        self._stream, config = stream, stream.config
        self.view = view = stream.view
        self._on_encoded = on_encoded
        self.stages = StageMeans()  # until the packets leave
        self._leaving: deque[int] = deque(maxlen=_LEAVING)  # when each was encoded [ns]
        self._parity = uplink.parity.get(view)
        self._packets: list[bytes] = []  # of the frame that is being packetised
        self._padding = Padding(padding_ssrc(config, view), config.mtu_bytes)
        self._padded_bytes = 0
        self._frames = ViewEncoder(stream, clock, self._encoded, on_dropped)
        self._clock = clock
        self._received = uplink.received.get(view)
        self._feedback = uplink.feedback
        self._may_resend = partial(uplink.may_resend, config.mtu_bytes)
        self._pacer = uplink.pacer
        self._unpaced_until_ns = 0
        self.sent = self._frames.sent
        self._failure = ""
        self._pipeline: Any = None
        ports = requested_ports(config, view)
        self._socket = UdpSocket(ports.host, ports.feedback, f"sender of view {view}")

    @property
    def feedback_port(self) -> int:
        """The port for the receiver's RTCP, from which all packets are sent."""
        return self._socket.port

    def start(self, link: ViewPorts) -> None:
        """Begin to send to `link`: the relay's entrances, or the receiver's own ports.

        Feedback counts from `link.rtp` alone.
        SetupError if GStreamer refuses.
        """
        self._link = link
        pipeline = gst.parse_pipeline(
            pipelines.session_sender(
                self._stream,
                self._frames.encoder_kbps,
                rtp_out=udp_sink("rtp_out", link.host, link.rtp),
                reports_out=udp_sink("reports_out", link.host, link.reports),
                feedback_in=udp_source("feedback_in", pipelines.RTCP_CAPS),
                feedback=self._feedback,
                paced=self._pacer is not None,
            )
        )
        self._pipeline = pipeline
        self._source = pipeline.get_by_name("frames")
        self._udpsink = pipeline.get_by_name("rtp_out")
        self._resender = pipeline.get_by_name("rtx")
        self._socket.connect(link.host, link.rtp)  # Linux lets it send to `link.reports` as well
        for end in ("rtp_out", "reports_out", "feedback_in"):
            self._socket.attach(pipeline.get_by_name(end))
        # else a session that sent RTCP before the first frame imposes a random SSRC
        session = pipeline.get_by_name("session")
        self._rtp_entrance = session.get_static_pad("send_rtp_sink")
        ssrc = media_ssrc(self._stream.config, self.view)
        session.get_property("internal-session").set_property("internal-ssrc", ssrc)
        if self._received is not None and self._feedback:
            self._listener: object = PacketFeedback(
                session, self._received, self._clock, self._may_resend, self._frames.fail
            )
        elif self._received is not None:
            self._listener = ReceptionReports(session, self._received, self._frames.fail)
        if self._resender is not None:
            self._set_structure("payload-type-map", pipelines.RTX_PAYLOAD_TYPES)
            self._set_structure("ssrc-map", pipelines.rtx_ssrcs(self._stream.config, self.view))
        kinds = gst.load().Gst.PadProbeType
        if self._pacer is not None:
            paced = pipeline.get_by_name("paced").get_static_pad("src")
            pace = partial(self._pace, self._pacer)
            gst.add_probe(paced, kinds.BUFFER | kinds.BUFFER_LIST, pace, self._frames.fail)
        if self._parity is not None:
            packets = pipeline.get_by_name("payloader").get_static_pad("src")
            protect = partial(self._on_packets, self._parity)
            gst.add_probe(packets, kinds.BUFFER | kinds.BUFFER_LIST, protect, self._frames.fail)
        self._frames.attach(pipeline)
        gst.set_playing(pipeline, f"the sender of view {self.view}")

    def push(self, frame: Frame, left_out: bool = False) -> None:
        """Encode and send `frame`; not if `left_out`, nor if its target cannot pay for it."""
        buffer = self._frames.admit(frame, self.wire_bytes - self._padded_bytes, left_out)
        if buffer is not None:
            if self._parity is not None:
                self._parity.captured(frame.image)
            self._source.emit("push-buffer", buffer)

    def pad(self, size_bytes: int) -> None:
        """Send so much beside the frames, which the target does not pay for; from one thread.

        Nothing is sent before the first frame has left, nor without feedback, which numbers it.
        """
        if not self._feedback or not self.wire_bytes:
            return
        for packet in self._padding.packets(size_bytes):
            self._padded_bytes += len(packet) + IP_UDP_HEADER_BYTES
            self._rtp_entrance.chain(gst.load().Gst.Buffer.new_wrapped(packet))

    def set_target_kbps(self, kbps: float) -> None:
        """The wire rate to meet from the next frame on: IP datagrams, repair included."""
        self._frames.set_target_kbps(kbps)

    @property
    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far: media, repair and padding."""
        return wire_bytes_sent(self._udpsink, self._link)

    def poll(self) -> str:
        """Look after the sender; its failure in one sentence, "" while it works."""
        if not self._failure and self._pipeline is not None:
            reason = self._frames.failure or gst.poll_bus(self._pipeline)
            if reason:
                self._failure = f"the sender of view {self.view} failed: {reason}"
        return self._failure

    def close(self) -> None:
        """Stop sending and free the port; may be called twice."""
        if self._pipeline is not None:
            gst.shut_down(self._pipeline)
        self._socket.close()

    def _encoded(self, frame: EncodedFrame) -> None:
        if self._pacer is not None:
            self._leaving.append(frame.encoded_ns)
        stages = self.stages
        stages.step("camera", frame.capture_ns, frame.ready_ns)
        stages.step("to_encoder", frame.ready_ns, frame.pushed_ns)
        stages.step("encoder", frame.pushed_ns, frame.encoded_ns)
        self._on_encoded(frame)

    def _on_packets(self, parity: ViewParity, pad: Any, probe: Any) -> Any:
        """In the encoder's thread: send a frame's parity behind its last packet."""
        Gst = gst.load().Gst
        for buffer in gst.buffers_of(probe):
            self._packets.append(buffer.extract_dup(0, buffer.get_size()))
        if not buffer.has_flags(Gst.BufferFlags.MARKER):
            return Gst.PadProbeReturn.OK
        packets, self._packets = self._packets, []
        if not (protecting := parity.protect(packets)):
            return Gst.PadProbeReturn.OK
        session = pad.get_peer()
        if probe.type & Gst.PadProbeType.BUFFER_LIST:
            session.chain_list(probe.get_buffer_list())
        else:
            session.chain(probe.get_buffer())
        for packet in protecting:
            behind = Gst.Buffer.new_wrapped(packet)
            behind.pts, behind.dts = buffer.pts, buffer.dts
            session.chain(behind)
        return Gst.PadProbeReturn.DROP

    def _pace(self, pacer: Pacer, pad: Any, probe: Any) -> Any:
        """In the thread of the queue `paced`: let the packets leave when it is their time."""
        Gst = gst.load().Gst
        buffers = list(gst.buffers_of(probe))
        sizes_bytes = [one.get_size() + IP_UDP_HEADER_BYTES for one in buffers]
        parts, now_ns = pacer.parts(sizes_bytes), self._clock.now_ns()
        if now_ns < self._unpaced_until_ns:
            self._leave(buffers[-1])
            return Gst.PadProbeReturn.OK
        leave_ns = [pacer.reserve(now_ns, sum(sizes_bytes[part])) for part in parts]
        if len(parts) == 1:
            self._clock.sleep_until_ns(leave_ns[0])
            self._leave(buffers[-1])
            return Gst.PadProbeReturn.OK
        while parts:
            self._clock.sleep_until_ns(leave_ns[0])
            # this thread may wake late, and then what has become due leaves together
            now_ns = self._clock.now_ns()
            due = max(1, sum(one <= now_ns for one in leave_ns))
            if now_ns - leave_ns[0] > _LATE_NS:
                self._unpaced_until_ns, due = now_ns + _UNPACED_NS, len(parts)
            together = Gst.BufferList.new()
            for one in buffers[parts[0].start : parts[due - 1].stop]:
                together.insert(-1, one)
            del parts[:due], leave_ns[:due]
            pad.get_peer().chain_list(together)
        self._leave(buffers[-1])
        return Gst.PadProbeReturn.DROP

    def _leave(self, last: Any) -> None:
        """Packets leave, or have left, the last of a frame's media perhaps among them."""
        if self._leaving and last.has_flags(gst.load().Gst.BufferFlags.MARKER):
            self.stages.step("sender", self._leaving.popleft(), self._clock.now_ns())

    def _set_structure(self, name: str, text: str) -> None:
        structure, _ = gst.load().Gst.Structure.from_string(text)
        self._resender.set_property(name, structure)

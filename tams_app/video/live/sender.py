"""One view's sender: frames in, H.264 over RTP out, at the rate it was given."""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Any

from tams_app import gst
from tams_app.records import IP_UDP_HEADER_BYTES, DroppedFrame, EncodedFrame, Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.pacer import Pacer
from tams_app.video.core.packets import RTP_HEADER_BYTES, TRANSPORT_SEQUENCE_BYTES, media_ssrc
from tams_app.video.core.rtcp import ReceivedFeedback, read_arrivals, read_blocks
from tams_app.video.core.sender import Sender, StreamSettings, Uplink
from tams_app.video.core.stages import StageMeans
from tams_app.video.live.udp import UdpSocket, ViewPorts, udp_sink, udp_source
from tams_app.video.live.view_codecs import TakeEncoded, ViewEncoder

# A machine that wakes threads so late has no time for pacing: frames leave at once for a while.
_LATE_NS, _UNPACED_NS = 5 * NS_PER_MS, 5 * NS_PER_S
_LEAVING = 64  # frames: more than the pacer ever holds
# the session counts a packet's payload alone
_HEADER_BYTES = IP_UDP_HEADER_BYTES + RTP_HEADER_BYTES + TRANSPORT_SEQUENCE_BYTES
_TRANSPORT_FEEDBACK = (205, 15)  # packet type and format


class VideoSender:
    """Encodes and sends one view; `push` from one thread, `set_target_kbps` from any.

    Construct, give the receiver's side `feedback_port`, `start`, `push` each frame, `close`. `sent`
    knows what the RTP timestamps of its packets stand for.
    """

    def __init__(
        self, stream: StreamSettings, uplink: Uplink, clock: Clock, take: TakeEncoded
    ) -> None:
        """Bind a port for feedback; SetupError if GStreamer lacks an element."""
        gst.require_elements()
        self.view = stream.view
        self._sender = Sender(stream, uplink)
        self.sent = self._sender.sent
        self.set_target_kbps = self._sender.set_target_kbps
        self._clock = clock
        self._take = take
        self.stages = StageMeans()  # until the packets leave
        self._leaving: deque[int] = deque(maxlen=_LEAVING)  # when each was encoded [ns]
        self._packets: list[bytes] = []  # of the frame that is being packetised
        self._pacer = uplink.pacer
        self._unpaced_until_ns = 0
        self._pipeline: gst.Pipeline | None = None
        self._socket = UdpSocket(f"sender of view {self.view}")

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
        sender, uplink = self._sender, self._sender.uplink
        description, what = self._description(link), f"the sender of view {self.view}"
        self._pipeline = pipeline = gst.Pipeline(description, what)
        self._source = pipeline["frames"]
        self._udpsink = pipeline["rtp_out"]
        self._socket.connect(link.host, link.rtp)  # Linux lets it send to `link.reports` as well
        for end in ("rtp_out", "reports_out", "feedback_in"):
            self._socket.attach(pipeline[end])
        # else a session that sent RTCP before the first frame imposes a random SSRC
        session = pipeline["session"]
        self._rtp_entrance = session.get_static_pad("send_rtp_sink")
        config = sender.stream.config
        internal = session.get_property("internal-session")
        internal.set_property("internal-ssrc", media_ssrc(config, self.view))
        kinds = gst.load().Gst.PadProbeType
        packets = kinds.BUFFER | kinds.BUFFER_LIST
        if sender.received is not None and uplink.feedback:
            self._listener = PacketFeedback(pipeline, sender, sender.received, self._clock)
        elif sender.received is not None:
            listen = partial(_on_reports, sender.received)
            pipeline.add_probe(session.get_static_pad("recv_rtcp_sink"), kinds.BUFFER, listen)
        pipeline.set_structure("rtx", "payload-type-map", pipelines.RTX_PAYLOAD_TYPES)
        pipeline.set_structure("rtx", "ssrc-map", pipelines.rtx_ssrcs(config, self.view))
        if self._pacer is not None:
            pace = partial(self._pace, self._pacer)
            pipeline.add_probe(pipeline["paced"].get_static_pad("src"), packets, pace)
        if sender.parity is not None:
            payloader = pipeline["payloader"].get_static_pad("src")
            pipeline.add_probe(payloader, packets, self._on_packets)
        self._encoder = ViewEncoder(sender, pipeline, self._clock, self._encoded)
        pipeline.play()

    def push(self, frame: Frame, left_out: bool = False) -> DroppedFrame | None:
        """Encode and send `frame`; not if `left_out`, nor if its target cannot pay for it."""
        admitted = self._sender.admit(frame, self.wire_bytes, self._clock.now_ns(), left_out)
        if isinstance(admitted, DroppedFrame):
            return admitted
        self._source.emit("push-buffer", self._encoder.buffer(frame, admitted))
        return None

    def pad(self, size_bytes: int) -> None:
        """Send so much beside the frames, which the target does not pay for; from one thread."""
        for packet in self._sender.padding(size_bytes, self.wire_bytes):
            self._rtp_entrance.chain(gst.load().Gst.Buffer.new_wrapped(packet))

    @property
    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far: media, repair and padding."""
        sent = self._udpsink.emit("get-stats", self._link.host, self._link.rtp)
        payload: int = sent.get_value("bytes-sent")  # exact, 3 µs, no packet callback
        packets: int = sent.get_value("packets-sent")
        return payload + packets * IP_UDP_HEADER_BYTES

    def poll(self) -> str:
        """Look after the sender; its failure in one sentence, "" while it works."""
        return "" if self._pipeline is None else self._pipeline.poll()

    def close(self) -> None:
        """Stop sending and free the port; may be called twice."""
        if self._pipeline is not None:
            self._pipeline.close()
        self._socket.close()

    def _description(self, link: ViewPorts) -> str:
        """Frames enter by the appsrc `frames`: with max-buffers=2 the first are lost while x264
        starts. Where packets are paced, resent ones are not.
        """
        stream, feedback = self._sender.stream, self._sender.uplink.feedback
        kbps, paced = self._sender.first_encoder_kbps, self._pacer is not None
        history = f"! rtprtxsend name=rtx max-size-time={pipelines.RTX_HISTORY_MS} "
        return (
            f"{pipelines.SENDING_SESSION} "
            "appsrc name=frames is-live=true format=time block=false max-buffers=4 "
            f'leaky-type=downstream caps="{pipelines.raw_caps(stream.config)}" '
            f"! {pipelines.encoder_chain(stream, kbps, feedback, paced)} "
            f"{history if stream.rtx else ''}! session.send_rtp_sink "
            f"session.send_rtp_src ! {udp_sink('rtp_out', link.host, link.rtp)} "
            f"session.send_rtcp_src ! {udp_sink('reports_out', link.host, link.reports)} "
            f"{udp_source('feedback_in', pipelines.RTCP_CAPS)} ! session.recv_rtcp_sink"
        )

    # --- in GStreamer's threads -----------------------------------------------------------------

    def _encoded(self, frame: EncodedFrame) -> None:
        if self._pacer is not None:
            self._leaving.append(frame.encoded_ns)
        stages = self.stages
        stages.step("camera", frame.capture_ns, frame.ready_ns)
        stages.step("to_encoder", frame.ready_ns, frame.pushed_ns)
        stages.step("encoder", frame.pushed_ns, frame.encoded_ns)
        self._take(frame)

    def _on_packets(self, pad: Any, probe: Any) -> Any:
        """In the encoder's thread: send a frame's parity behind its last packet."""
        Gst = gst.load().Gst
        for buffer in gst.buffers_of(probe):
            self._packets.append(buffer.extract_dup(0, buffer.get_size()))
        if not buffer.has_flags(Gst.BufferFlags.MARKER):
            return Gst.PadProbeReturn.OK
        packets, self._packets = self._packets, []
        if not (protecting := self._sender.protect(packets)):
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
        now_ns = self._clock.now_ns()
        if now_ns < self._unpaced_until_ns:
            self._leave(buffers[-1])
            return Gst.PadProbeReturn.OK
        waiting = pacer.schedule(now_ns, sizes_bytes)
        if len(waiting) == 1:
            self._clock.sleep_until_ns(waiting[0][0])
            self._leave(buffers[-1])
            return Gst.PadProbeReturn.OK
        while waiting:
            leaves_ns, first = waiting[0]
            self._clock.sleep_until_ns(leaves_ns)
            # this thread may wake late, and then what has become due leaves together
            now_ns = self._clock.now_ns()
            due = max(1, sum(one_ns <= now_ns for one_ns, _ in waiting))
            if now_ns - leaves_ns > _LATE_NS:
                self._unpaced_until_ns, due = now_ns + _UNPACED_NS, len(waiting)
            together = Gst.BufferList.new()
            for one in buffers[first.start : waiting[due - 1][1].stop]:
                together.insert(-1, one)
            del waiting[:due]
            pad.get_peer().chain_list(together)
        self._leave(buffers[-1])
        return Gst.PadProbeReturn.DROP

    def _leave(self, last: Any) -> None:
        """Packets leave, or have left, the last of a frame's media perhaps among them."""
        if self._leaving and last.has_flags(gst.load().Gst.BufferFlags.MARKER):
            self.stages.step("sender", self._leaving.popleft(), self._clock.now_ns())


class PacketFeedback:
    """Hands to `received` what is reported of each packet, never in Python for each of them.

    The session reports which packets a message is about, when they left and how large they were.
    When they arrived is read from the message itself: GStreamer 1.22 misreads long gaps (`rtcp`).
    Both come in one thread, the message first. Before a packet is sent again, `sender` is asked.
    """

    def __init__(
        self, pipeline: gst.Pipeline, sender: Sender, received: ReceivedFeedback, clock: Clock
    ) -> None:
        self._pipeline, self._sender = pipeline, sender
        self._received, self._clock = received, clock
        self._arrived_ns: dict[int, int] = {}
        session = pipeline["session"]
        internal = session.get_property("internal-session")
        internal.connect("on-feedback-rtcp", self._on_feedback)
        entrance = session.get_static_pad("send_rtp_sink")
        kinds = gst.load().Gst.PadProbeType
        pipeline.add_probe(entrance, kinds.EVENT_UPSTREAM, self._on_event)

    def _on_feedback(self, _: Any, kind: int, form: int, *about: Any) -> None:
        try:
            if (kind, form) == _TRANSPORT_FEEDBACK:
                message = about[-1]  # a buffer, after the SSRCs; None: nothing follows these
                content = b"" if message is None else message.extract_dup(0, message.get_size())
                self._arrived_ns = read_arrivals(content)
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            self._pipeline.fail(error)

    def _on_event(self, pad: Any, probe: Any) -> Any:
        structure = probe.get_event().get_structure()
        name = "" if structure is None else structure.get_name()
        if name == "RTPTWCCPackets":
            self._report(structure.get_value("packets"))
        elif name == "GstRTPRetransmissionRequest" and not self._sender.may_retransmit():
            return gst.load().Gst.PadProbeReturn.DROP
        return gst.load().Gst.PadProbeReturn.OK

    def _report(self, packets: Any) -> None:
        if not self._arrived_ns:  # a damaged message
            return
        rows = [
            (
                packet.get_value("seqnum"),
                packet.get_value("local-ts"),
                packet.get_value("size") + _HEADER_BYTES,
            )
            for packet in packets
        ]
        self._received.report(self._clock.now_ns(), rows, self._arrived_ns)


def _on_reports(received: ReceivedFeedback, _pad: Any, probe: Any) -> Any:
    """Hand on the report blocks of a datagram that comes."""
    modules, buffer = gst.load(), probe.get_buffer()
    datagram = buffer.extract_dup(0, buffer.get_size())
    wall_ns = modules.GLib.get_real_time() * 1000  # the session's own source of it
    received.blocks(read_blocks(datagram, wall_ns))
    return modules.Gst.PadProbeReturn.OK

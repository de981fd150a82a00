"""The ends of a chain in virtual time: a pad of our own pushes in, an appsink hands out.

A push returns when the encoder has encoded, or when the jitter buffer has taken the packet; what
the jitter buffer's own threads do with it is awaited by `wait_idle`. The codecs are x264 and avdec
whatever the configuration says: others answer from threads of their own.
"""

from __future__ import annotations

from typing import Any

from tams_app import gst
from tams_app.errors import TamsError
from tams_app.video.core import pipelines
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.stream import StreamSettings
from tams_app.video.live.view_decoder import ViewDecoder
from tams_app.video.live.view_encoder import ViewEncoder
from tams_app.video.virtual.stepped_clock import SteppedClock


class Chain:
    """A pipeline on the stepped clock; what is pushed enters its element `first`."""

    def __init__(
        self, description: str, first: str, caps: str, clock: SteppedClock, what: str
    ) -> None:
        Gst = gst.load().Gst
        self.pipeline = gst.parse_pipeline(description)
        self._what = what
        self._ok = Gst.FlowReturn.OK
        clock.drive(self.pipeline)
        self.entrance = self.pipeline.get_by_name(first).get_static_pad("sink")
        self._pad = Gst.Pad.new("feed", Gst.PadDirection.SRC)
        self._pad.set_active(True)
        self._caps = caps
        self._is_first = True

    def start(self) -> None:
        """Begin to play; SetupError if GStreamer refuses."""
        Gst = gst.load().Gst
        gst.set_playing(self.pipeline, self._what)
        self._pad.link(self.entrance)
        segment = Gst.Segment()
        segment.init(Gst.Format.TIME)
        for event in (
            Gst.Event.new_stream_start(self._what),
            Gst.Event.new_caps(Gst.Caps.from_string(self._caps)),
            Gst.Event.new_segment(segment),
        ):
            self._pad.push_event(event)

    def push(self, buffer: Any) -> None:
        """Hand a buffer in; TamsError if the chain does not take it.

        The first is marked as such, as every source of GStreamer does: the depayloader's request
        for a keyframe at the start hangs on it.
        """
        if self._is_first:
            self._is_first = False
            buffer.set_flags(gst.load().Gst.BufferFlags.DISCONT)
        flow = self._pad.push(buffer)
        if flow != self._ok:
            reason = gst.poll_bus(self.pipeline) or flow.value_nick
            raise TamsError(f"{self._what} failed: {reason}")

    def close(self) -> None:
        """End the chain and its threads; may be called twice."""
        self._pad.set_active(False)
        gst.shut_down(self.pipeline)


class EncoderChain(Chain):
    """Frames in, RTP packets out, one after the other."""

    def __init__(
        self,
        stream: StreamSettings,
        frames: ViewEncoder,
        clock: SteppedClock,
        feedback: bool = False,
    ) -> None:
        description = (
            f"{pipelines.encoder_chain(stream, frames.encoder_kbps, feedback)} "
            "! appsink name=packets async=false sync=false"
        )
        caps, what = pipelines.raw_caps(stream.config), f"the sender of view {stream.view}"
        super().__init__(description, "converter", caps, clock, what)
        self._packets = self.pipeline.get_by_name("packets")
        self._requests = self.pipeline.get_by_name("payloader").get_static_pad("src")
        frames.attach(self.pipeline)

    def encode(self, buffer: Any) -> list[bytes]:
        self.push(buffer)
        buffers = gst.pull_available(self._packets)
        return [each.extract_dup(0, each.get_size()) for each in buffers]

    def request_keyframe(self) -> None:
        """Make the next frame a keyframe, as rtpsession does when a PLI comes."""
        modules = gst.load()
        self._requests.send_event(
            modules.GstVideo.video_event_new_upstream_force_key_unit(
                modules.Gst.CLOCK_TIME_NONE, False, 0
            )
        )


class DecoderChain(Chain):
    """RTP packets in, frames out through a `ViewDecoder`, requests kept until they are taken."""

    def __init__(
        self,
        view: str,
        rule: RepairRule,
        frames: ViewDecoder,
        clock: SteppedClock,
    ) -> None:
        Gst = gst.load().Gst
        description = f"{pipelines.decoder_chain(rule)} ! {pipelines.SHOWN_FRAMES}"
        what = f"the receiver of view {view}"
        super().__init__(description, "jitterbuffer", pipelines.rtp_caps(), clock, what)
        self._clock = clock
        self._nacks: list[tuple[int, int]] = []
        self._plis = 0
        # live, what leaves the jitter buffer upstream goes to the session
        self.entrance.add_probe(Gst.PadProbeType.EVENT_UPSTREAM, self._on_request)
        frames.attach(self.pipeline)

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

    def poll(self) -> str:
        """The first error of the chain, "" if there is none."""
        return gst.poll_bus(self.pipeline)

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

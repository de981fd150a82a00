"""One view into the encoder and out of the decoder, the same live and in virtual time.

`VideoSender` and `VideoReceiver` put it behind sockets, `tams_app.video.virtual` under a virtual
clock. What is decided is decided by `Sender` and `Receiver` of `tams_app.video.core`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeAlias

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.records import EncodedFrame, Frame, ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.video.core import pipelines
from tams_app.video.core.codecs import bgr_of, i420_of
from tams_app.video.core.frame_identity import Identify, rtp_timestamp
from tams_app.video.core.packets import RTP_HEADER_BYTES
from tams_app.video.core.receiver import Receiver, has_idr
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.sender import AdmittedFrame, Sender

TakeEncoded: TypeAlias = Callable[[EncodedFrame], None]
"""Gets each encoded frame, in the encoder's thread: it must only hand over."""
TakeShown: TypeAlias = Callable[[ShownFrame], None]
"""Gets each decoded frame, in the decoder's thread: it must only hand over."""


class ViewEncoder:
    """The encoder of a chain: each frame at the bitrate of its admission, its output identified."""

    def __init__(
        self, sender: Sender, pipeline: gst.Pipeline, clock: Clock, take: TakeEncoded
    ) -> None:
        """The chain was built with the sender's `first_encoder_kbps`.

        `clock`: when a frame counts as encoded.
        """
        self._sender, self._clock, self._take = sender, clock, take
        self._kbps = sender.first_encoder_kbps
        self._encoder = pipeline["encoder"]
        frames = self._encoder.get_static_pad("src")
        pipeline.add_probe(frames, gst.load().Gst.PadProbeType.BUFFER, self._on_output)

    def buffer(self, frame: Frame, admitted: AdmittedFrame) -> Any:
        """The frame as the chain takes it; push it before the next one is asked for."""
        if admitted.encoder_kbps != self._kbps:
            self._kbps = admitted.encoder_kbps
            self._encoder.set_property("bitrate", self._kbps)
        return gst.raw_buffer(i420_of(frame.image), admitted.pts_ns, admitted.duration_ns)

    def _on_output(self, pad: Any, probe: Any) -> Any:
        Gst, buffer = gst.load().Gst, probe.get_buffer()
        encoded_ns = self._clock.now_ns()
        # x264enc, for one, shifts PTS by 1000 h and says so in its segment
        segment = pad.get_sticky_event(Gst.EventType.SEGMENT, 0).parse_segment()
        timestamp = rtp_timestamp(segment.to_running_time(Gst.Format.TIME, buffer.pts))
        keyframe = not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)
        data = buffer.extract_dup(0, buffer.get_size())
        self._take(self._sender.encoded(encoded_ns, timestamp, keyframe, data))
        return Gst.PadProbeReturn.OK


class ViewDecoder:
    """Moves a `Receiver` by what passes in a decoder chain, and does in the chain what it says."""

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        pipeline: gst.Pipeline,
        clock: Clock,
        identify: Identify,
        take: TakeShown,
    ) -> None:
        """Take the elements of a `decoder_chain` that ends in the appsink `frames`."""
        self._receiver = Receiver(view, config.fps, rule, identify, threading.Lock())
        self._config, self._pipeline = config, pipeline
        self._clock, self._take = clock, take
        kinds = gst.load().Gst.PadProbeType
        buffers = kinds.BUFFER | kinds.BUFFER_LIST
        self.jitterbuffer = pipeline["jitterbuffer"]
        for element in (self.jitterbuffer, pipeline["ptdemux"]):
            element.connect("request-pt-map", caps_of_payload_type)
        self._depayloader = depayloader = pipeline["depayloader"]
        self._request_pad = depayloader.get_static_pad("sink")
        entrance, exit_ = map(self.jitterbuffer.get_static_pad, ("sink", "src"))
        access_units = depayloader.get_static_pad("src")
        pipeline.add_probe(entrance, buffers, self._on_first_arrival)
        pipeline.add_probe(exit_, buffers, self._on_first_packet)
        pipeline.add_probe(self._request_pad, kinds.EVENT_UPSTREAM, self._on_upstream_event)
        pipeline.add_probe(access_units, kinds.BUFFER, self._on_access_unit)
        pipeline["frames"].connect("new-sample", self._on_frame)

    # --- in GStreamer's threads -------------------------------------------------------------

    def _on_first_arrival(self, pad: Any, probe: Any) -> Any:
        """Let the jitter buffer's latency count from the first packet's arrival, then leave.

        With mode=none its clock starts at the pipeline's start, so that a receiver that waited
        for its sender would give every gap up at once.
        """
        first = next(gst.buffers_of(probe))
        self.jitterbuffer.set_property("ts-offset", first.dts)
        return gst.load().Gst.PadProbeReturn.REMOVE

    def _on_first_packet(self, pad: Any, probe: Any) -> Any:
        """Anchor the frame identity, then leave: no Python per packet."""
        first = next(gst.buffers_of(probe))
        self._receiver.first_packet(first.pts, first.extract_dup(0, RTP_HEADER_BYTES))
        return gst.load().Gst.PadProbeReturn.REMOVE

    def _on_upstream_event(self, pad: Any, probe: Any) -> Any:
        """Let a keyframe request of the depayloader pass, or keep it for later."""
        modules = gst.load()
        results = modules.Gst.PadProbeReturn
        if not modules.GstVideo.video_event_is_force_key_unit(probe.get_event()):
            return results.OK
        leaves = self._receiver.request(self._clock.now_ns(), self._newest_timestamp())
        return results.OK if leaves else results.DROP

    def _on_access_unit(self, pad: Any, probe: Any) -> Any:
        """Judge it. One with the marker ends with the packet that the depayloader is at."""
        flags, buffer, now_ns = gst.load().Gst.BufferFlags, probe.get_buffer(), self._clock.now_ns()
        may_have_idr = not buffer.has_flags(flags.DELTA_UNIT)
        verdict = self._receiver.access_unit(
            now_ns,
            buffer.pts,
            self._newest_timestamp(),
            may_have_idr and has_idr(buffer.extract_dup(0, buffer.get_size())),
            buffer.has_flags(flags.MARKER),
        )
        if verdict.wait_ms is not None:
            self.jitterbuffer.set_property("latency", verdict.wait_ms)
        if verdict.shift_ns:  # the jitter buffer's PTS restart where 3 s of RTP time lack
            offset_ns = self.jitterbuffer.get_property("ts-offset")
            self.jitterbuffer.set_property("ts-offset", offset_ns + verdict.shift_ns)
            buffer.pts += verdict.shift_ns
        if verdict.asks_keyframe:
            self._request_keyframe()
        return gst.load().Gst.PadProbeReturn.OK

    def _newest_timestamp(self) -> int:
        """Of the packet that the depayloader is at."""
        timestamp: int = self._depayloader.get_property("stats").get_value("timestamp")
        return timestamp

    def _request_keyframe(self) -> None:
        """Send a request past our own probe, straight to the element before the depayloader."""
        modules = gst.load()
        event = modules.GstVideo.video_event_new_upstream_force_key_unit(
            modules.Gst.CLOCK_TIME_NONE, True, 0
        )
        before = self._request_pad.get_peer()
        if before is not None:
            before.send_event(event)

    def _on_frame(self, appsink: Any) -> Any:
        Gst = gst.load().Gst
        try:
            self._show(appsink.emit("pull-sample").get_buffer())
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            self._pipeline.fail(error)
            return Gst.FlowReturn.ERROR
        return Gst.FlowReturn.OK

    def _show(self, buffer: Any) -> None:
        if (known := self._receiver.identified(buffer.pts)) is not None:
            image = bgr_of(gst.pixels_of(buffer), self._config.height, self._config.width)
            self._take(self._receiver.shown(self._clock.now_ns(), *known, image))


def caps_of_payload_type(_: Any, *arguments: int) -> Any:
    """Answer `request-pt-map`; its last argument is the payload type."""
    return gst.load().Gst.Caps.from_string(pipelines.rtp_caps(arguments[-1]))

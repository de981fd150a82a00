"""One view into the encoder and out of it, the same live and in virtual time.

`sender.VideoSender` puts it behind sockets, `tams_app.video.virtual` under a virtual clock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app import gst
from tams_app.errors import TamsError
from tams_app.records import DroppedFrame, EncodedFrame, Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S
from tams_app.video.core.colour import i420_of
from tams_app.video.core.frame_identity import SentFrame, SentFrames, rtp_timestamp
from tams_app.video.core.frame_interval import FrameIntervals
from tams_app.video.core.rate_control import EncoderServo, SourceDrop
from tams_app.video.core.stream import StreamSettings


class ViewEncoder:
    """Decides what is encoded and at which rate, and reports what came out.

    `admit` from one thread, `set_target_kbps` from any. `on_encoded` runs in the encoder's thread
    once per frame, `on_dropped` in the thread that admits: both must only hand over.
    `sent`: what the stream's timestamps stand for.
    """

    def __init__(
        self,
        stream: StreamSettings,
        clock: Clock,
        on_encoded: Callable[[EncodedFrame], None],
        on_dropped: Callable[[DroppedFrame], None],
    ) -> None:
        self.view, config = stream.view, stream.config
        self.failure = ""
        self.sent = SentFrames()
        self._clock = clock
        self._on_encoded = on_encoded
        self._on_dropped = on_dropped
        self._target_kbps = stream.start_kbps
        self._source_drop = SourceDrop(stream.source_drop_below_kbps)
        first_ns = NS_PER_S // config.fps
        self._intervals = FrameIntervals(first_ns)
        self._servo = EncoderServo(config.mtu_bytes)
        frame_kbps = self._source_drop.frame_target_kbps(stream.start_kbps, first_ns)
        self.encoder_kbps = round(self._servo.encoder_kbps(frame_kbps, first_ns))

    def attach(self, pipeline: Any) -> None:
        """Take the `encoder` of a chain that was built with `encoder_kbps`."""
        self._encoder = pipeline.get_by_name("encoder")
        frames = self._encoder.get_static_pad("src")
        kinds = gst.load().Gst.PadProbeType
        gst.add_probe(frames, kinds.BUFFER, self._on_encoder_output, self.fail)

    def set_target_kbps(self, kbps: float) -> None:
        """The wire rate to meet from the next frame on: IP datagrams, repair included."""
        self._target_kbps = kbps

    def admit(self, frame: Frame, wire_bytes: int, left_out: bool = False) -> Any | None:
        """The buffer to encode for `frame`; None if its target cannot pay for it, or `left_out`.

        `wire_bytes`: IP datagram bytes that have left so far, repair packets included.
        """
        pushed_ns, target_kbps = self._clock.now_ns(), self._target_kbps
        time = self._intervals.step(frame.capture_ns)
        kept = not left_out and self._source_drop.keep(target_kbps, time.usual_ns)
        if not kept:
            self._on_dropped(DroppedFrame(frame.view, frame.index, frame.capture_ns, left_out))
            return None
        frame_kbps = self._source_drop.frame_target_kbps(target_kbps, time.usual_ns)
        encoder_kbps = self._servo.step(wire_bytes, frame_kbps, time)
        if encoder_kbps != self.encoder_kbps:
            self._encoder.set_property("bitrate", encoder_kbps)
            self.encoder_kbps = encoder_kbps
        sent = SentFrame(frame.index, frame.capture_ns, pushed_ns, frame.ready_ns)
        pts_ns = self.sent.add(sent)
        return gst.raw_buffer(i420_of(frame.image), pts_ns, time.usual_ns)

    # --- in the encoder's thread ------------------------------------------------------------

    def fail(self, reason: str) -> None:
        """Frames no longer leave as they should: the owner is notified by `failure`."""
        self.failure = reason

    def _on_encoder_output(self, pad: Any, probe: Any) -> Any:
        Gst, buffer = gst.load().Gst, probe.get_buffer()
        encoded_ns = self._clock.now_ns()
        # x264enc, for one, shifts PTS by 1000 h and says so in its segment
        segment = pad.get_sticky_event(Gst.EventType.SEGMENT, 0).parse_segment()
        running_ns = segment.to_running_time(Gst.Format.TIME, buffer.pts)
        timestamp = rtp_timestamp(running_ns)
        sent = self.sent.find(timestamp)
        if sent is None:
            raise TamsError(f"the encoder returned timestamp {timestamp}, which was never pushed")
        keyframe = not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)
        data = buffer.extract_dup(0, buffer.get_size())
        self._on_encoded(
            EncodedFrame(
                self.view,
                sent.index,
                sent.capture_ns,
                encoded_ns,
                keyframe,
                data,
                sent.pushed_ns,
                timestamp,
                sent.ready_ns,
            )
        )
        return Gst.PadProbeReturn.OK

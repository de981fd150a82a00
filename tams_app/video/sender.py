"""One view's sender: pictures in, H.264 over RTP out, at the rate it was given."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tams_app import gst
from tams_app.clock import NS_PER_S, Clock
from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import DroppedFrame, EncodedFrame, Frame
from tams_app.video import pipelines
from tams_app.video.encoder_servo import EncoderServo
from tams_app.video.frame_identity import index_of_pts, pts_of_index
from tams_app.video.ports import ViewPorts, media_ssrc, requested_ports
from tams_app.video.shells import UdpSocket, wire_bytes_sent
from tams_app.video.source_drop import SourceDrop


@dataclass(frozen=True, slots=True)
class SenderStats:
    """What a sender has done so far."""

    frames_encoded: int
    frames_dropped: int  # left out at the source, target too low
    frames_lost: int  # pushed, but overrun in front of a busy encoder
    keyframes: int
    wire_bytes: int  # IP datagrams: media, repair
    rtx_requests: int
    rtx_packets: int
    encoder_kbps: int  # what the servo asks of x264 now


class VideoSender:
    """Encodes and sends one view; `push` from one thread, `set_target_kbps` from any.

    `on_encoded` runs in the encoder's thread, once per frame: it must only hand over.
    `on_dropped` runs in the thread that pushes. `start_kbps`: target until the first is set.
    """

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rtx: bool,
        clock: Clock,
        start_kbps: float,
        source_drop_below_kbps: float,
        on_encoded: Callable[[EncodedFrame], None],
        on_dropped: Callable[[DroppedFrame], None],
    ) -> None:
        """Bind the port for feedback; ConfigError if it is taken, SetupError without GStreamer."""
        gst.require_elements()
        self.view = view
        self._config = config
        self._rtx = rtx
        self._clock = clock
        self._on_encoded = on_encoded
        self._on_dropped = on_dropped
        self._target_kbps = start_kbps
        self._encoder_kbps = 0
        self._source_drop = SourceDrop(source_drop_below_kbps)
        self._servo = EncoderServo(config.fps, config.mtu_bytes)
        self._lock = threading.Lock()
        self._underway: dict[int, tuple[int, int]] = {}  # captured and pushed, not yet encoded
        self._encoded = self._dropped = self._lost = self._keyframes = 0
        self._failure = ""
        self._pipeline: Any = None
        ports = requested_ports(config, view)
        self._socket = UdpSocket(ports.host, ports.feedback, f"sender of view {view}")

    @property
    def feedback_port(self) -> int:
        """Where the receiver's RTCP must arrive."""
        return self._socket.port

    def start(self, link: ViewPorts) -> None:
        """Begin to send into the link's entrances; SetupError if GStreamer refuses."""
        self._link = link
        frame_target_kbps = self._source_drop.frame_target_kbps(self._target_kbps)
        start_kbps = round(self._servo.payload_kbps(frame_target_kbps))
        pipeline = gst.parse_pipeline(
            pipelines.live_sender(self._config, self.view, self._rtx, start_kbps, link)
        )
        self._pipeline = pipeline
        self._encoder_kbps = start_kbps
        self._pictures = pipeline.get_by_name("pictures")
        self._encoder = pipeline.get_by_name("encoder")
        self._udpsink = pipeline.get_by_name("rtp_out")
        self._resender = pipeline.get_by_name("rtx")
        self._socket.attach(pipeline.get_by_name("feedback_in"))
        # else a session that sent RTCP before the first picture imposes a random SSRC
        session = pipeline.get_by_name("session").get_property("internal-session")
        session.set_property("internal-ssrc", media_ssrc(self._config, self.view))
        if self._resender is not None:
            self._set_structure("payload-type-map", pipelines.rtx_payload_types())
            self._set_structure("ssrc-map", pipelines.rtx_ssrcs(self._config, self.view))
        self._encoder.get_static_pad("src").add_probe(
            gst.load().Gst.PadProbeType.BUFFER, self._on_encoder_output
        )
        gst.set_playing(pipeline, f"the sender of view {self.view}")

    def push(self, frame: Frame) -> None:
        """Encode and send `frame`, or drop it at the source if its target cannot pay for it."""
        pushed_ns, target_kbps = self._clock.now_ns(), self._target_kbps
        if not self._source_drop.keep(target_kbps):
            self._dropped += 1
            self._on_dropped(DroppedFrame(frame.view, frame.index, frame.capture_ns))
            return
        frame_target_kbps = self._source_drop.frame_target_kbps(target_kbps)
        self._set_encoder_rate(wire_bytes_sent(self._udpsink, self._link), frame_target_kbps)
        with self._lock:
            self._underway[frame.index] = (frame.capture_ns, pushed_ns)
        fps = self._config.fps
        buffer = gst.raw_buffer(
            frame.image.tobytes(), pts_of_index(frame.index, fps), NS_PER_S // fps
        )
        self._pictures.emit("push-buffer", buffer)

    def set_target_kbps(self, kbps: float) -> None:
        """The wire rate to meet from the next frame on: IP datagrams, repair included."""
        self._target_kbps = kbps

    def stats(self) -> SenderStats:
        """Counts since the start."""
        resender = self._resender
        return SenderStats(
            frames_encoded=self._encoded,
            frames_dropped=self._dropped,
            frames_lost=self._lost,
            keyframes=self._keyframes,
            wire_bytes=wire_bytes_sent(self._udpsink, self._link),
            rtx_requests=resender.get_property("num-rtx-requests") if resender else 0,
            rtx_packets=resender.get_property("num-rtx-packets") if resender else 0,
            encoder_kbps=self._encoder_kbps,
        )

    def poll(self) -> str:
        """Why this sender no longer works, in one sentence; "" while it does."""
        if not self._failure and self._pipeline is not None:
            reason = gst.poll_bus(self._pipeline)
            if reason:
                self._failure = f"the sender of view {self.view} failed: {reason}"
        return self._failure

    def close(self) -> None:
        """Stop sending and free the port; may be called twice."""
        if self._pipeline is not None:
            gst.shut_down(self._pipeline)
        self._socket.close()

    def _set_encoder_rate(self, wire_bytes: int, frame_target_kbps: float) -> None:
        encoder_kbps = self._servo.step(wire_bytes, frame_target_kbps)
        if encoder_kbps != self._encoder_kbps:
            self._encoder.set_property("bitrate", encoder_kbps)
            self._encoder_kbps = encoder_kbps

    def _set_structure(self, name: str, text: str) -> None:
        structure, _ = gst.load().Gst.Structure.from_string(text)
        self._resender.set_property(name, structure)

    def _on_encoder_output(self, pad: Any, probe: Any) -> Any:
        modules = gst.load()
        try:
            self._hand_over(pad, probe.get_buffer(), modules.Gst)
        except Exception as error:  # noqa: BLE001 - the owner is told by poll()
            self._failure = f"the sender of view {self.view} failed: {error!r}"
        return modules.Gst.PadProbeReturn.OK

    def _hand_over(self, pad: Any, buffer: Any, Gst: Any) -> None:
        encoded_ns = self._clock.now_ns()
        # x264enc shifts PTS by 1000 h and says so in its segment
        segment = pad.get_sticky_event(Gst.EventType.SEGMENT, 0).parse_segment()
        running_ns = segment.to_running_time(Gst.Format.TIME, buffer.pts)
        index = index_of_pts(running_ns, self._config.fps)
        keyframe = not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)
        capture_ns, pushed_ns = self._take_underway(index)
        self._encoded += 1
        self._keyframes += keyframe
        data = buffer.extract_dup(0, buffer.get_size())
        self._on_encoded(
            EncodedFrame(self.view, index, capture_ns, encoded_ns, keyframe, data, pushed_ns)
        )

    def _take_underway(self, index: int) -> tuple[int, int]:
        """When `index` was captured and pushed [ns]; earlier ones that never came out are lost."""
        with self._lock:
            times = self._underway.pop(index, None)
            overrun = [earlier for earlier in self._underway if earlier < index]
            for earlier in overrun:
                del self._underway[earlier]
            self._lost += len(overrun)
        if times is None:
            raise TamsError(f"the encoder returned frame {index}, which was never pushed")
        return times

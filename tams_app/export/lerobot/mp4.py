"""An MP4 file of constant frame rate in which every frame can be found exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tams_app import gst
from tams_app.errors import LogError
from tams_app.units import NS_PER_S
from tams_app.video.core.colour import Planes

# Constant quality, near to lossless beside what the uplink took, but never above a given rate. A
# learner reads frames in any order: for one it decodes ten at most. Without B frames the first has
# the time 0.
_QUANTIZER = 20
_KEYFRAME_INTERVAL = 10
_LOWEST_KBPS = 50
BUFFER_S = 1.0  # over which the rate is held
_ELEMENTS = ("x264enc", "h264parse", "mp4mux", "filesink")
_END_NS = 60 * NS_PER_S


class Mp4Writer:
    """Encodes frames one by one in the thread that writes them; frame n is shown at n / fps."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        """Create the file; SetupError if GStreamer lacks an element, LogError if it cannot be."""
        gst.require_elements(_ELEMENTS)
        Gst = gst.load().Gst
        self.frames = 0
        self._path = path
        self._fps = fps
        self._ok = Gst.FlowReturn.OK
        self._pipeline = gst.parse_pipeline(
            f"x264enc name=encoder pass=qual quantizer={_QUANTIZER} tune=zerolatency threads=1 "
            f"speed-preset=veryfast key-int-max={_KEYFRAME_INTERVAL} bframes=0 "
            f"bitrate={_LOWEST_KBPS} vbv-buf-capacity={BUFFER_S * 1000:.0f} "
            "! video/x-h264,profile=high ! h264parse ! mp4mux "
            "! filesink name=file sync=false buffer-mode=unbuffered"
        )
        self._pipeline.get_by_name("file").set_property("location", str(path))
        self._encoder = self._pipeline.get_by_name("encoder")
        self._pad = Gst.Pad.new("frames", Gst.PadDirection.SRC)
        self._pad.set_active(True)
        self._pad.link(self._encoder.get_static_pad("sink"))
        if self._pipeline.set_state(Gst.State.PLAYING) == Gst.StateChangeReturn.FAILURE:
            raise self._failed()
        segment = Gst.Segment()
        segment.init(Gst.Format.TIME)
        caps = (
            f"video/x-raw,format=I420,width={width},height={height},framerate={fps}/1,"
            "colorimetry=bt601,interlace-mode=progressive,pixel-aspect-ratio=1/1"
        )
        for event in (
            Gst.Event.new_stream_start(path.name),
            Gst.Event.new_caps(Gst.Caps.from_string(caps)),
            Gst.Event.new_segment(segment),
        ):
            self._pad.push_event(event)

    def limit(self, kbps: float) -> None:
        """Hold the frames that follow to this rate [kbit/s]."""
        self._encoder.set_property("bitrate", max(round(kbps), _LOWEST_KBPS))

    def begin_episode(self) -> None:
        """Let the next frame be a keyframe: it refers to none of another episode."""
        modules = gst.load()
        at_ns = self._time_ns(self.frames)
        self._pad.push_event(
            modules.GstVideo.video_event_new_downstream_force_key_unit(at_ns, at_ns, at_ns, True, 0)
        )

    def write(self, planes: Planes) -> None:
        """Add a frame; LogError if it cannot be encoded or written."""
        at_ns = self._time_ns(self.frames)
        buffer = gst.raw_buffer(planes, at_ns, self._time_ns(self.frames + 1) - at_ns)
        if self._pad.push(buffer) != self._ok:
            raise self._failed()
        self.frames += 1

    def close(self) -> None:
        """Finish the file; LogError if it cannot be."""
        modules = gst.load()
        kinds = modules.Gst.MessageType
        self._pad.push_event(modules.Gst.Event.new_eos())
        ended: Any = self._pipeline.get_bus().timed_pop_filtered(_END_NS, kinds.EOS | kinds.ERROR)
        if ended is None or ended.type != kinds.EOS:
            raise self._failed("" if ended is None else ended.parse_error()[0].message)
        self.abandon()

    def abandon(self) -> None:
        """Let go of the file as it is; may be called twice."""
        self._pad.set_active(False)
        gst.shut_down(self._pipeline)

    def _time_ns(self, frame: int) -> int:
        return frame * NS_PER_S // self._fps

    def _failed(self, reason: str = "") -> LogError:
        reason = reason or gst.poll_bus(self._pipeline) or "no reason given"
        self.abandon()
        return LogError(f"{self._path}: cannot be written: {reason}")

"""One view from jitter buffer and decoder to the newest frame, live and in virtual time.

`receiver.VideoReceiver` puts it behind sockets, `tams_app.video.virtual` under a virtual clock.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.runtime.mailbox import Mailbox
from tams_app.units import NS_PER_S
from tams_app.video.core import pipelines
from tams_app.video.core.colour import bgr_of
from tams_app.video.core.frame_identity import RtpTimes, SentFrame
from tams_app.video.core.frame_interval import FrameIntervals
from tams_app.video.core.repair import KeyframeRequests, RepairRule, WholeChain, has_idr

_RTP_SEQUENCE = slice(2, 4)  # of the RTP header (RFC 3550)
_RTP_TIMESTAMP = slice(4, 8)
_WAIT_TOLERANCE_MS = 10
_DECODING = 64  # frames: more than any decoder keeps


class ViewDecoder:
    """Identifies the frames of a decoder chain, and requests keyframes.

    The newest frame waits in `mailbox`. `identify` gives which capture an RTP timestamp stands for:
    what the receiver needs of the sender (`SentFrames.find`). `on_shown` runs in the decoder's
    thread, once per frame: it must only hand over. `failure`: why frames no longer come, "" while
    they do.
    """

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        clock: Clock,
        identify: Callable[[int], SentFrame | None],
        on_shown: Callable[[ShownFrame], None],
    ) -> None:
        self.mailbox: Mailbox[ShownFrame] = Mailbox()
        self.failure = ""
        self._view = view
        self._config = config
        self._clock = clock
        self._identify = identify
        self._on_shown = on_shown
        self._times: RtpTimes | None = None
        self._rule = rule
        self._intervals = FrameIntervals(NS_PER_S // config.fps)
        self._wait_ms = rule.latency_ms
        self._requests = KeyframeRequests(rule.pli_interval_ms)
        self._requests_lock = threading.Lock()
        self._asks_for_keyframes = rule.pli
        self._start_request_is_idle = False
        self._chain = WholeChain()
        self._whole: deque[int] = deque(maxlen=_DECODING)  # RTP timestamps of whole frames
        # by RTP timestamp, when the jitter buffer had handed out the last packet [ns]
        self._received: deque[tuple[int, int]] = deque(maxlen=_DECODING)

    def attach(self, pipeline: Any) -> None:
        """Take the elements of a `decoder_chain` that ends in the appsink `frames`."""
        kinds = gst.load().Gst.PadProbeType
        buffers = kinds.BUFFER | kinds.BUFFER_LIST
        self.jitterbuffer = pipeline.get_by_name("jitterbuffer")
        for element in (self.jitterbuffer, pipeline.get_by_name("ptdemux")):
            element.connect("request-pt-map", caps_of_payload_type)
        self._depayloader = depayloader = pipeline.get_by_name("depayloader")
        self._request_pad = depayloader.get_static_pad("sink")
        entrance, exit_ = map(self.jitterbuffer.get_static_pad, ("sink", "src"))
        access_units = depayloader.get_static_pad("src")
        gst.add_probe(entrance, buffers, self._on_first_arrival, self._fail)
        gst.add_probe(exit_, buffers, self._on_first_packet, self._fail)
        gst.add_probe(self._request_pad, kinds.EVENT_UPSTREAM, self._on_upstream_event, self._fail)
        gst.add_probe(access_units, kinds.BUFFER, self._on_access_unit, self._fail)
        pipeline.get_by_name("frames").connect("new-sample", self._on_frame)

    # --- in GStreamer's threads -------------------------------------------------------------

    def _fail(self, reason: str) -> None:
        self.failure = reason

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
        header = first.extract_dup(0, 12)
        timestamp = int.from_bytes(header[_RTP_TIMESTAMP], "big")
        self._times = RtpTimes(first.pts, timestamp)
        # the depayloader asks for a keyframe at every start; packet 0 begins with one
        self._start_request_is_idle = header[_RTP_SEQUENCE] == b"\0\0"
        return gst.load().Gst.PadProbeReturn.REMOVE

    def _on_upstream_event(self, pad: Any, probe: Any) -> Any:
        """Let a keyframe request of the depayloader pass, or keep it for later.

        It makes one for each gap, when the first packet after it has come.
        """
        modules = gst.load()
        results = modules.Gst.PadProbeReturn
        if not modules.GstVideo.video_event_is_force_key_unit(probe.get_event()):
            return results.OK
        if self._start_request_is_idle:
            self._start_request_is_idle = False
            return results.DROP
        self._chain.gap(self._newest_timestamp())
        if not self._asks_for_keyframes:
            return results.DROP
        with self._requests_lock:
            return results.OK if self._requests.request(self._clock.now_ns()) else results.DROP

    def _on_access_unit(self, pad: Any, probe: Any) -> Any:
        """Judge it. One with the marker ends with the packet that the depayloader is at."""
        Gst = gst.load().Gst
        buffer = probe.get_buffer()
        timestamp = self._newest_timestamp()
        self._received.append((timestamp, self._clock.now_ns()))
        has_end = buffer.has_flags(Gst.BufferFlags.MARKER)
        if has_end and self._keep_in_line(buffer, timestamp):
            # where about 65,536 packets or a multiple were lost, their numbers show no gap
            self._chain.gap(timestamp)
        may_have_idr = not buffer.has_flags(Gst.BufferFlags.DELTA_UNIT)
        is_keyframe = may_have_idr and has_idr(buffer.extract_dup(0, buffer.get_size()))
        if self._chain.access_unit(timestamp, is_keyframe, has_end):
            self._whole.append(timestamp)
        self._step_requests()
        return Gst.PadProbeReturn.OK

    def _newest_timestamp(self) -> int:
        """Of the packet that the depayloader is at."""
        timestamp: int = self._depayloader.get_property("stats").get_value("timestamp")
        return timestamp

    def _keep_in_line(self, access_unit: Any, timestamp: int) -> bool:
        """Undo a jump of the jitter buffer's PTS, which restart where 3 s of RTP time lack.

        Whether there was one.
        """
        if self._times is None:
            return False
        shift_ns = self._times.follow(access_unit.pts, timestamp)
        self._wait_for_resends(self._times.followed_ns)
        if shift_ns:
            offset_ns = self.jitterbuffer.get_property("ts-offset")
            self.jitterbuffer.set_property("ts-offset", offset_ns + shift_ns)
            access_unit.pts += shift_ns
        return bool(shift_ns)

    def _wait_for_resends(self, followed_ns: int) -> None:
        wait_ms = self._rule.wait_ms(self._intervals.step(followed_ns).usual_ns)
        if abs(wait_ms - self._wait_ms) > _WAIT_TOLERANCE_MS:
            self._wait_ms = wait_ms
            self.jitterbuffer.set_property("latency", wait_ms)

    def _on_frame(self, appsink: Any) -> Any:
        Gst = gst.load().Gst
        try:
            self._show(appsink.emit("pull-sample").get_buffer())
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            self.failure = repr(error)
            return Gst.FlowReturn.ERROR
        return Gst.FlowReturn.OK

    def _show(self, buffer: Any) -> None:
        if self._times is None:
            raise TamsError("a frame came out before a packet went in")
        timestamp = self._times.timestamp(buffer.pts)
        sent = self._identify(timestamp)
        if sent is None:
            return  # a frame of unknown age is not to be steered by
        image = bgr_of(gst.pixels_of(buffer), self._config.height, self._config.width)
        now_ns = self._clock.now_ns()
        whole = timestamp in self._whole
        received_ns = next((ns for one, ns in reversed(self._received) if one == timestamp), 0)
        shown = ShownFrame(
            self._view, sent.index, now_ns, image, sent.capture_ns, whole, received_ns
        )
        self.mailbox.put(shown)
        self._on_shown(shown)

    # --- keyframe requests ------------------------------------------------------------------

    def _step_requests(self) -> None:
        """After each access unit, request a keyframe while decoding is broken."""
        if not self._asks_for_keyframes:
            return
        with self._requests_lock:
            self._requests.chain(self._chain.unbroken)
            due = self._requests.due(self._clock.now_ns())
        if due:
            self._request_keyframe()

    def _request_keyframe(self) -> None:
        """Send a request past our own probe, straight to the element before the depayloader."""
        modules = gst.load()
        event = modules.GstVideo.video_event_new_upstream_force_key_unit(
            modules.Gst.CLOCK_TIME_NONE, True, 0
        )
        before = self._request_pad.get_peer()
        if before is not None:
            before.send_event(event)


def caps_of_payload_type(_: Any, *arguments: int) -> Any:
    """Answer `request-pt-map`; its last argument is the payload type."""
    return gst.load().Gst.Caps.from_string(pipelines.rtp_caps(arguments[-1]))

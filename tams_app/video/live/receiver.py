"""One view's receiver: RTP in, the newest frame in a mailbox."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import TamsError
from tams_app.records import ShownFrame
from tams_app.runtime.clock import Clock
from tams_app.video.core import pipelines
from tams_app.video.core.codecs import AVDEC, Decoder
from tams_app.video.core.frame_identity import SentFrame
from tams_app.video.core.packets import media_ssrc, parity_ssrc, receiver_ssrc
from tams_app.video.core.parity import ParityDecoder
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import UdpSocket, ViewPorts, requested_ports, udp_sink, udp_source
from tams_app.video.live.view_decoder import ViewDecoder, caps_of_payload_type


class VideoReceiver:
    """Receives and decodes one view; the newest frame waits in `mailbox`.

    Construct, give the sender's side the ports, `start`, read `mailbox`, `poll`, `close`.
    """

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        clock: Clock,
        identify: Callable[[int], SentFrame | None],
        on_shown: Callable[[ShownFrame], None],
        feedback: bool = False,
        decoder: Decoder = AVDEC,
    ) -> None:
        """Bind the ports for RTP and for the sender's RTCP; ConfigError if one is taken.

        `identify` and `on_shown` are those of the `ViewDecoder`. `feedback`: whether it reports
        when each packet came; the sender must agree, as with `rule.rtx`. `decoder`: one that is
        here (`installed_codecs`). SetupError if GStreamer lacks an element.
        """
        gst.require_elements()
        self.view = view
        self._config = config
        self._rule = rule
        self._feedback = feedback
        self._decoder = decoder
        self._frames = ViewDecoder(view, config, rule, clock, identify, on_shown)
        self.mailbox = self._frames.mailbox
        self._failure = ""
        self._pipeline: Any = None
        ports = requested_ports(config, view)
        what = f"receiver of view {view}"
        self._rtp_socket = UdpSocket(ports.host, ports.rtp, what)
        try:
            self._reports_socket = UdpSocket(ports.host, ports.reports, what)
        except TamsError:
            self._rtp_socket.close()
            raise

    @property
    def rtp_port(self) -> int:
        """The port for media and repair packets, from which feedback is sent."""
        return self._rtp_socket.port

    @property
    def reports_port(self) -> int:
        """The port for the sender's RTCP."""
        return self._reports_socket.port

    def start(self, link: ViewPorts) -> None:
        """Begin to receive from `link.feedback`, where feedback goes to. SetupError if refused."""
        Gst = gst.load().Gst
        pipeline = gst.parse_pipeline(
            pipelines.session_receiver(
                self._config,
                self.view,
                self._rule,
                rtp_in=udp_source("rtp_in", pipelines.received_caps(self._feedback)),
                reports_in=udp_source("reports_in", pipelines.RTCP_CAPS),
                feedback_out=udp_sink("feedback_out", link.host, link.feedback),
                decoder=self._decoder,
            )
        )
        self._pipeline = pipeline
        if self._feedback:
            gst.count_from_boot(pipeline)  # arrivals of all views on one clock
        for one in (self._rtp_socket, self._reports_socket):
            one.connect(link.host, link.feedback)
        for end in ("rtp_in", "feedback_out"):
            self._rtp_socket.attach(pipeline.get_by_name(end))
        self._reports_socket.attach(pipeline.get_by_name("reports_in"))
        self._resent = pipeline.get_by_name("rtx")
        if self._resent is not None:
            structure, _ = Gst.Structure.from_string(pipelines.RTX_PAYLOAD_TYPES)
            self._resent.set_property("payload-type-map", structure)
        session = pipeline.get_by_name("session")
        session.connect("request-pt-map", caps_of_payload_type)
        ssrc = receiver_ssrc(self._config, self.view)  # shows where its feedback belongs
        session.get_property("internal-session").set_property("internal-ssrc", ssrc)
        pipeline.get_by_name("ssrcdemux").connect("pad-added", self._on_stream)
        if self._rule.parity:
            self._recent = pipeline.get_by_name("recent")
            self._parity = ParityDecoder(media_ssrc(self._config, self.view))
            pipeline.get_by_name("parity").connect("new-sample", self._on_parity)
        self._frames.attach(pipeline)
        gst.set_playing(pipeline, f"the receiver of view {self.view}")

    def poll(self) -> str:
        """Look after the receiver; its failure in one sentence, "" while it works."""
        if not self._failure and self._pipeline is not None:
            reason = self._frames.failure or gst.poll_bus(self._pipeline)
            if reason:
                self._failure = f"the receiver of view {self.view} failed: {reason}"
        return self._failure

    def close(self) -> None:
        """Stop receiving and free the ports; may be called twice."""
        if self._pipeline is not None:
            gst.shut_down(self._pipeline)
        self._rtp_socket.close()
        self._reports_socket.close()

    # --- in GStreamer's threads -------------------------------------------------------------

    def _on_stream(self, _: Any, pad: Any) -> None:
        """Drain other senders' packets: an unlinked stream would end the whole receiver."""
        name = pad.get_name()
        own = [media_ssrc(self._config, self.view)]
        own += [parity_ssrc(self._config, self.view)] * self._rule.parity
        if not name.startswith("src_") or name in {f"src_{ssrc}" for ssrc in own}:
            return
        drain = gst.load().Gst.ElementFactory.make("fakesink")
        drain.set_property("async", False)
        self._pipeline.add(drain)
        drain.sync_state_with_parent()
        pad.link(drain.get_static_pad("sink"))

    def _on_parity(self, appsink: Any) -> Any:
        """Restore what a frame's parity can; media and parity come in one thread."""
        try:
            self._restore(appsink)
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            self._frames.failure = repr(error)
        return gst.load().Gst.FlowReturn.OK

    def _restore(self, appsink: Any) -> None:
        Gst = gst.load().Gst
        restored: list[bytes] = []
        for buffer in gst.pull_available(self._recent):
            restored += self._parity.media(buffer.extract_dup(0, buffer.get_size()))
        for buffer in gst.pull_available(appsink):
            restored += self._parity.parity(buffer.extract_dup(0, buffer.get_size()))
            arrived_ns = buffer.dts
        entrance = self._frames.jitterbuffer.get_static_pad("sink")
        for packet in restored:
            lost = Gst.Buffer.new_wrapped(packet)
            lost.dts = arrived_ns
            entrance.chain(lost)

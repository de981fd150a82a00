"""One view's receiver: RTP in, frames out."""

from __future__ import annotations

from functools import partial
from typing import Any

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.runtime.clock import Clock
from tams_app.video.core import pipelines
from tams_app.video.core.frame_identity import Identify
from tams_app.video.core.packets import media_ssrc, parity_ssrc, receiver_ssrc
from tams_app.video.core.parity import ParityDecoder
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import HOST, UdpSocket, ViewPorts, udp_sink, udp_source
from tams_app.video.live.view_codecs import TakeShown, ViewDecoder, caps_of_payload_type


class VideoReceiver:
    """Receives and decodes one view.

    Construct, give the sender's side `ports`, `start`, `poll`, `close`.
    """

    def __init__(
        self,
        view: str,
        config: VideoConfig,
        rule: RepairRule,
        clock: Clock,
        identify: Identify,
        take: TakeShown,
        feedback: bool = False,
    ) -> None:
        """Bind ports for RTP and for the sender's RTCP.

        `feedback`: whether it reports when each packet came; the sender must agree, as with
        `rule.rtx`. SetupError if GStreamer lacks an element.
        """
        gst.require_elements()
        self.view = view
        self._config = config
        self._rule = rule
        self._feedback = feedback
        self._clock, self._identify, self._take = clock, identify, take
        self._pipeline: gst.Pipeline | None = None
        what = f"receiver of view {view}"
        self._rtp_socket, self._reports_socket = UdpSocket(what), UdpSocket(what)
        rtp, reports = self._rtp_socket.port, self._reports_socket.port
        self.ports = ViewPorts(HOST, rtp, reports, 0)  # where its packets must arrive

    def start(self, link: ViewPorts) -> None:
        """Begin to receive from `link.feedback`, where feedback goes to. SetupError if refused."""
        description, what = self._description(link), f"the receiver of view {self.view}"
        self._pipeline = pipeline = gst.Pipeline(description, what)
        if self._feedback:
            gst.count_from_boot(pipeline.elements)  # arrivals of all views on one clock
        for one in (self._rtp_socket, self._reports_socket):
            one.connect(link.host, link.feedback)
        for end in ("rtp_in", "feedback_out"):
            self._rtp_socket.attach(pipeline[end])
        self._reports_socket.attach(pipeline["reports_in"])
        pipeline.set_structure("rtx", "payload-type-map", pipelines.RTX_PAYLOAD_TYPES)
        session = pipeline["session"]
        session.connect("request-pt-map", caps_of_payload_type)
        ssrc = receiver_ssrc(self._config, self.view)  # shows where its feedback belongs
        session.get_property("internal-session").set_property("internal-ssrc", ssrc)
        pipeline["ssrcdemux"].connect("pad-added", partial(self._on_stream, pipeline))
        self.decoder = ViewDecoder(
            self.view, self._config, self._rule, pipeline, self._clock, self._identify, self._take
        )
        if self._rule.parity:
            self._parity = ParityDecoder(media_ssrc(self._config, self.view))
            pipeline["parity"].connect("new-sample", partial(self._on_parity, pipeline))
        pipeline.play()

    def poll(self) -> str:
        """Look after the receiver; its failure in one sentence, "" while it works."""
        return "" if self._pipeline is None else self._pipeline.poll()

    def close(self) -> None:
        """Stop receiving and free the ports; may be called twice."""
        if self._pipeline is not None:
            self._pipeline.close()
        self._rtp_socket.close()
        self._reports_socket.close()

    def _description(self, link: ViewPorts) -> str:
        """Frames leave by the appsink `frames`; only the view's own SSRCs are linked on.

        With parity, `recent` keeps the media packets that `parity` may need.
        """
        rule, config, view = self._rule, self._config, self.view
        media = f"ssrcdemux.src_{media_ssrc(config, view)} ! "
        if rule.parity:
            media = (
                f"ssrcdemux.src_{parity_ssrc(config, view)} ! {pipelines.PARITY_SINK} "
                f"{media} tee name=media media. ! {pipelines.RECENT_SINK} media. ! "
            )
        return (
            f"{pipelines.RECEIVING_SESSION} "
            f"{udp_source('rtp_in', pipelines.received_caps(self._feedback))} "
            "! session.recv_rtp_sink session.recv_rtp_src "
            f"{'! rtprtxreceive name=rtx ' if rule.rtx else ''}! rtpssrcdemux name=ssrcdemux "
            f"{media}{pipelines.decoder_chain(rule)} ! {pipelines.SHOWN_FRAMES} "
            f"{udp_source('reports_in', pipelines.RTCP_CAPS)} ! session.recv_rtcp_sink "
            f"session.send_rtcp_src ! {udp_sink('feedback_out', link.host, link.feedback)}"
        )

    # --- in GStreamer's threads -------------------------------------------------------------

    def _on_stream(self, pipeline: gst.Pipeline, _: Any, pad: Any) -> None:
        """Drain other senders' packets: an unlinked stream would end the whole receiver."""
        name = pad.get_name()
        own = [media_ssrc(self._config, self.view)]
        own += [parity_ssrc(self._config, self.view)] * self._rule.parity
        if not name.startswith("src_") or name in {f"src_{ssrc}" for ssrc in own}:
            return
        drain = gst.load().Gst.ElementFactory.make("fakesink")
        drain.set_property("async", False)
        pipeline.elements.add(drain)
        drain.sync_state_with_parent()
        pad.link(drain.get_static_pad("sink"))

    def _on_parity(self, pipeline: gst.Pipeline, appsink: Any) -> Any:
        """Restore what a frame's parity can; media and parity come in one thread."""
        try:
            self._restore(pipeline["recent"], appsink)
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            pipeline.fail(error)
        return gst.load().Gst.FlowReturn.OK

    def _restore(self, recent: Any, appsink: Any) -> None:
        Gst = gst.load().Gst
        restored: list[bytes] = []
        for buffer in gst.pull_available(recent):
            restored += self._parity.media(buffer.extract_dup(0, buffer.get_size()))
        for buffer in gst.pull_available(appsink):
            restored += self._parity.parity(buffer.extract_dup(0, buffer.get_size()))
            arrived_ns = buffer.dts
        entrance = self.decoder.jitterbuffer.get_static_pad("sink")
        for packet in restored:
            lost = Gst.Buffer.new_wrapped(packet)
            lost.dts = arrived_ns
            entrance.chain(lost)

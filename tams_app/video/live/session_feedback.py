"""Listens to the RTCP that a sender's rtpsession gets, live.

Python runs once for each datagram or message, never per packet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tams_app import gst
from tams_app.records import IP_UDP_HEADER_BYTES
from tams_app.runtime.clock import Clock
from tams_app.video.core.packets import RTP_HEADER_BYTES, TRANSPORT_SEQUENCE_BYTES
from tams_app.video.core.received_feedback import ReceivedFeedback
from tams_app.video.core.rtcp import read_arrivals, read_blocks

# the session counts a packet's payload alone
_HEADER_BYTES = IP_UDP_HEADER_BYTES + RTP_HEADER_BYTES + TRANSPORT_SEQUENCE_BYTES
_TRANSPORT_FEEDBACK = (205, 15)  # packet type and format


class ReceptionReports:
    """Hands the report blocks that come to `received`; `fail` gets the reason of a failure."""

    def __init__(
        self, session: Any, received: ReceivedFeedback, fail: Callable[[str], None]
    ) -> None:
        self._received = received
        kinds = gst.load().Gst.PadProbeType
        entrance = session.get_static_pad("recv_rtcp_sink")
        gst.add_probe(entrance, kinds.BUFFER, self._on_rtcp, fail)

    def _on_rtcp(self, pad: Any, probe: Any) -> Any:
        buffer = probe.get_buffer()
        datagram = buffer.extract_dup(0, buffer.get_size())
        wall_ns = gst.load().GLib.get_real_time() * 1000  # the session's own source of it
        self._received.blocks(read_blocks(datagram, wall_ns))
        return gst.load().Gst.PadProbeReturn.OK


class PacketFeedback:
    """Hands to `received` what is reported of each packet; `fail` gets the reason of a failure.

    The session reports which packets a message is about, when they left and how large they were.
    When they arrived is read from the message itself: GStreamer 1.22 misreads long gaps (`rtcp`).
    Both come in one thread, the message first. `may_resend` is asked before a packet is sent again.
    """

    def __init__(
        self,
        session: Any,
        received: ReceivedFeedback,
        clock: Clock,
        may_resend: Callable[[], bool],
        fail: Callable[[str], None],
    ) -> None:
        self._may_resend, self._fail = may_resend, fail
        self._received = received
        self._clock = clock
        self._arrived_ns: dict[int, int] = {}
        internal = session.get_property("internal-session")
        internal.connect("on-feedback-rtcp", self._on_feedback)
        kinds = gst.load().Gst.PadProbeType
        entrance = session.get_static_pad("send_rtp_sink")
        gst.add_probe(entrance, kinds.EVENT_UPSTREAM, self._on_event, fail)

    def _on_feedback(self, _: Any, kind: int, form: int, *about: Any) -> None:
        try:
            if (kind, form) == _TRANSPORT_FEEDBACK:
                message = about[-1]  # a buffer, after the SSRCs; None: nothing follows these
                content = b"" if message is None else message.extract_dup(0, message.get_size())
                self._arrived_ns = read_arrivals(content)
        except Exception as error:  # noqa: BLE001 - the shell notifies the owner
            self._fail(repr(error))

    def _on_event(self, pad: Any, probe: Any) -> Any:
        structure = probe.get_event().get_structure()
        name = "" if structure is None else structure.get_name()
        if name == "RTPTWCCPackets":
            self._report(structure.get_value("packets"))
        elif name == "GstRTPRetransmissionRequest" and not self._may_resend():
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

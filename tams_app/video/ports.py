"""Where a view's three UDP flows go, and the fixed numbers its RTP streams carry."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import VideoConfig

MEDIA_PAYLOAD_TYPE = 96
REPAIR_PAYLOAD_TYPE = 97  # RTX (RFC 4588)
_FIRST_SSRC = 0x54410000


@dataclass(frozen=True, slots=True)
class ViewPorts:
    """UDP ports of one view's three flows, all on one host; 0 asks for any free port.

    The same record says where the flows enter the link and where they come out of it. Without a
    link the two are equal.
    """

    host: str
    rtp: int  # sender -> receiver: media and RTX
    reports: int  # sender -> receiver: RTCP (sender reports)
    feedback: int  # receiver -> sender: RTCP (receiver reports, NACK, PLI)


def requested_ports(config: VideoConfig, view: str) -> ViewPorts:
    """The ports a view's sender and receiver bind: three from `first_port` on, or any."""
    if config.first_port == 0:
        return ViewPorts(config.bind_host, 0, 0, 0)
    first = config.first_port + 3 * config.views.index(view)
    return ViewPorts(config.bind_host, first, first + 1, first + 2)


def media_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC of a view's media stream, fixed so that a packet tells its view."""
    return _FIRST_SSRC + 2 * config.views.index(view)


def repair_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC of a view's RTX stream."""
    return media_ssrc(config, view) + 1

"""Padding: RTP packets without content, which show what the uplink carries beside the views."""

from __future__ import annotations

from tams_app.records import IP_UDP_HEADER_BYTES
from tams_app.video.core.packets import (
    PADDING_PAYLOAD_TYPE,
    RTP_HEADER_BYTES,
    SEQUENCES,
    TRANSPORT_SEQUENCE_BYTES,
    rtp_header,
)

_HEADER_BYTES = IP_UDP_HEADER_BYTES + RTP_HEADER_BYTES + TRANSPORT_SEQUENCE_BYTES


class Padding:
    """Makes the padding packets of one session, which numbers them as it does all others."""

    def __init__(self, ssrc: int, mtu_bytes: int) -> None:
        """`mtu_bytes`: the payloader's, RTP header included."""
        self._ssrc = ssrc
        self._most_bytes = mtu_bytes + IP_UDP_HEADER_BYTES
        self._sequence = 0

    def packets(self, size_bytes: int) -> list[bytes]:
        """Packets that take `size_bytes` [IP datagrams], or a packet's headers if that is more.

        The last one is marked as the end of a frame is, so that the receiver reports them at once.
        """
        count = -(-size_bytes // self._most_bytes)
        return [
            self._packet((size_bytes + place) // count, last=place == count - 1)
            for place in range(count)
        ]

    def _packet(self, size_bytes: int, *, last: bool) -> bytes:
        header = rtp_header(
            PADDING_PAYLOAD_TYPE, self._sequence, 0, self._ssrc, marker=last, numbered=True
        )
        self._sequence = (self._sequence + 1) % SEQUENCES
        return header + bytes(max(0, size_bytes - _HEADER_BYTES))

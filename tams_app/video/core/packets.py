"""RTP packets (RFC 3550): the fixed numbers of our streams, reading of headers, padding."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from tams_app.config import VideoConfig
from tams_app.records import IP_UDP_HEADER_BYTES, PacketKind

MEDIA_PAYLOAD_TYPE = 96
REPAIR_PAYLOAD_TYPE = 97  # RTX (RFC 4588)
RTP_HEADER_BYTES = 12
# The header extension that numbers all packets of a session, as GStreamer's payloader writes it:
# profile and length, then its own byte, the number and one of padding.
_DRAFT = "draft-holmer-rmcat-transport-wide-cc-extensions-01"
TRANSPORT_SEQUENCE_URI = f"http://www.ietf.org/id/{_DRAFT}"
TRANSPORT_SEQUENCE_BYTES = 8
_TRANSPORT_SEQUENCE = slice(17, 19)
_NUMBERED = b"\xbe\xde\x00\x01\x11\x00\x00\x00"  # profile, one word, extension 1 of two bytes
PARITY_PAYLOAD_TYPE = 98  # ours (`parity`)
PADDING_PAYLOAD_TYPE = 99  # ours (`Padding`)
SEQUENCES = 1 << 16

_FIRST_SSRC = 0x54410000
_FIRST_PARITY_SSRC = 0x54420000
_FIRST_PADDING_SSRC = 0x54430000
_FIRST_RECEIVER_SSRC = 0x54440000
_KINDS = {
    REPAIR_PAYLOAD_TYPE: PacketKind.REPAIR,
    PARITY_PAYLOAD_TYPE: PacketKind.PARITY,
    PADDING_PAYLOAD_TYPE: PacketKind.PADDING,
}
_RTP_HEADER = struct.Struct("!BBHII")
_VERSION = 2
_VERSION_BITS, _EXTENDED, _MARKER = 0x80, 0x10, 0x80
_HEADER_BYTES = IP_UDP_HEADER_BYTES + RTP_HEADER_BYTES + TRANSPORT_SEQUENCE_BYTES


@dataclass(frozen=True, slots=True)
class RtpHeader:
    """The fixed header of one RTP packet and where its payload begins."""

    payload_type: int
    marker: bool
    sequence: int
    timestamp: int
    payload_offset: int

    @property
    def kind(self) -> PacketKind:
        return _KINDS.get(self.payload_type, PacketKind.MEDIA)


def media_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC of a view's media stream, fixed so that a packet identifies its view."""
    return _FIRST_SSRC + 2 * config.views.index(view)


def repair_ssrc(config: VideoConfig, view: str) -> int:
    return media_ssrc(config, view) + 1


def parity_ssrc(config: VideoConfig, view: str) -> int:
    return _FIRST_PARITY_SSRC + config.views.index(view)


def padding_ssrc(config: VideoConfig, view: str) -> int:
    return _FIRST_PADDING_SSRC + config.views.index(view)


def receiver_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC with which a view's receiver signs its feedback."""
    return _FIRST_RECEIVER_SSRC + config.views.index(view)


def stream_ssrcs(config: VideoConfig, view: str) -> tuple[int, ...]:
    """Every SSRC under which a view's sender may send RTP or RTCP."""
    of_each = (media_ssrc, repair_ssrc, parity_ssrc, padding_ssrc)
    return tuple(one(config, view) for one in of_each)


def read_rtp(datagram: bytes) -> RtpHeader | None:
    """The header of an RTP packet, None if the bytes are none."""
    if len(datagram) < _RTP_HEADER.size or datagram[0] >> 6 != _VERSION:
        return None
    first, second, sequence, timestamp, _ = _RTP_HEADER.unpack_from(datagram)
    offset = _RTP_HEADER.size + 4 * (first & 0x0F)  # contributing sources
    if first & 0x10:  # header extension: profile, length in words
        if len(datagram) < offset + 4:
            return None
        offset += 4 + 4 * int.from_bytes(datagram[offset + 2 : offset + 4], "big")
    if offset > len(datagram):
        return None
    return RtpHeader(second & 0x7F, bool(second & 0x80), sequence, timestamp, offset)


def rtp_header(
    payload_type: int,
    sequence: int,
    timestamp: int,
    ssrc: int,
    *,
    marker: bool = False,
    numbered: bool = False,
) -> bytes:
    """The header of a packet of ours; `numbered`: with room for the transport-wide number."""
    first, second = _VERSION_BITS | _EXTENDED * numbered, payload_type | _MARKER * marker
    header = _RTP_HEADER.pack(first, second, sequence, timestamp, ssrc)
    return header + _NUMBERED * numbered


def transport_sequence(packet: bytes) -> int:
    """The transport-wide sequence number of a packet of ours that has the extension."""
    return int.from_bytes(packet[_TRANSPORT_SEQUENCE])


def with_transport_sequence(packet: bytes, sequence: int) -> bytes:
    """`packet`, which has the extension, with this number in it."""
    start, end = _TRANSPORT_SEQUENCE.start, _TRANSPORT_SEQUENCE.stop
    return packet[:start] + sequence.to_bytes(2) + packet[end:]


def identify(datagram: bytes) -> tuple[PacketKind, int, int]:
    """Kind, sequence number of the media carried, and RTP timestamp of a datagram of the RTP flow.

    A resent packet (RTX) has the number of the original, a parity packet that of the first packet
    it protects; both lead the payload. Padding has neither. What is no RTP reads as media with
    number and timestamp 0: the link carries it all the same.
    """
    header = read_rtp(datagram)
    if header is None:
        return PacketKind.MEDIA, 0, 0
    kind = header.kind
    if kind is PacketKind.MEDIA:
        return kind, header.sequence, header.timestamp
    if kind is PacketKind.PADDING:
        return kind, 0, 0
    start = header.payload_offset
    original = int.from_bytes(datagram[start : start + 2], "big")
    return kind, original, header.timestamp


class Padding:
    """Packets without content, which show what the uplink carries beside the views.

    The session numbers them as it does all others.
    """

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

"""RTP packets (RFC 3550): the fixed numbers of our streams, and reading of headers."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from tams_app.config import VideoConfig
from tams_app.records import PacketKind

MEDIA_PAYLOAD_TYPE = 96
REPAIR_PAYLOAD_TYPE = 97  # RTX (RFC 4588)

_FIRST_SSRC = 0x54410000
_RTP_HEADER = struct.Struct("!BBHII")
_VERSION = 2


@dataclass(frozen=True, slots=True)
class RtpHeader:
    """The fixed header of one RTP packet and where its payload begins."""

    payload_type: int
    marker: bool
    sequence: int
    timestamp: int
    payload_offset: int


def media_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC of a view's media stream, fixed so that a packet tells its view."""
    return _FIRST_SSRC + 2 * config.views.index(view)


def repair_ssrc(config: VideoConfig, view: str) -> int:
    """The SSRC of a view's RTX stream."""
    return media_ssrc(config, view) + 1


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


def identify(datagram: bytes) -> tuple[PacketKind, int, int]:
    """Kind, sequence number of the media carried, and RTP timestamp of a datagram of the RTP flow.

    A resent packet (RTX) tells the number of the original, which leads its payload. What is no
    RTP reads as media with number and timestamp 0: the link carries it all the same.
    """
    header = read_rtp(datagram)
    if header is None:
        return PacketKind.MEDIA, 0, 0
    if header.payload_type != REPAIR_PAYLOAD_TYPE:
        return PacketKind.MEDIA, header.sequence, header.timestamp
    start = header.payload_offset
    original = int.from_bytes(datagram[start : start + 2], "big")
    return PacketKind.REPAIR, original, header.timestamp

"""Parity of a frame's packets: any one packet lost of a group is restored bit for bit, at once.

A parity packet is the XOR of the packets of its group, as in RFC 5109 and 8627: their payloads,
lengths and markers; the timestamp, which a frame's packets share, is its own. The groups of a frame
interleave, and its parity packets continue the turn behind the last packet, so `groups` packets
lost in a row are restored too. Two lost of one group are not. Pure: bytes in, bytes out.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Sequence
from functools import reduce
from operator import xor

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image
from tams_app.video.core.packets import (
    MEDIA_PAYLOAD_TYPE,
    PARITY_PAYLOAD_TYPE,
    SEQUENCES,
    read_rtp,
    rtp_header,
)

# first sequence number, packets, distance between their numbers, markers, lengths
_GROUP = struct.Struct("!HBBBH")
HEADER_BYTES = _GROUP.size  # what a parity packet is longer than the longest that it protects
_MOST_PACKETS = 255
_KEPT_PACKETS = 1024
_KEPT_WAITING = 64
_GRID = 16  # pixels between two that are looked at
_GREEN = 1
_CHANGE = 12  # of 255: more than a camera's noise
_SMOOTHING = 1 / 30  # a second of frames


class ViewParity:
    """Protects one view's frames; `groups` may be set by any thread.

    Attributes:
        groups: parity packets for each frame, 0 for none; fewer come of a frame of fewer packets.
        packets_per_frame: media packets, smoothed over a second.
        changed_share: of the picture since the frame before, smoothed over a second.
    """

    def __init__(self, ssrc: int, numbered: bool = False) -> None:
        """`numbered`: its packets have room for the session's number, by which reports know it."""
        self.groups = 0
        self.packets_per_frame = 1.0
        self.changed_share = 0.0
        self._ssrc = ssrc
        self._numbered = numbered
        self._sequence = 0
        self._last: NDArray[np.int16] | None = None

    def captured(self, image: Image) -> None:
        """A frame that will be encoded: 20 µs."""
        seen = image[_GRID // 2 :: _GRID, _GRID // 2 :: _GRID, _GREEN].astype(np.int16)
        if self._last is not None and seen.shape == self._last.shape:
            changed = float(np.mean(np.abs(seen - self._last) > _CHANGE))
            self.changed_share += _SMOOTHING * (changed - self.changed_share)
        self._last = seen

    def protect(self, packets: Sequence[bytes]) -> list[bytes]:
        """The parity packets of one frame, to be sent behind its last packet.

        Args:
            packets: the frame's RTP packets, numbered one after the other.

        Returns:
            The parity packets, of which the last is marked as a frame's end is, so that the
            receiver reports them at once; none of a frame that is no RTP, or too long for a group.
        """
        self.packets_per_frame += _SMOOTHING * (len(packets) - self.packets_per_frame)
        groups = min(self.groups, len(packets))
        if groups == 0 or -(-len(packets) // groups) > _MOST_PACKETS or groups > _MOST_PACKETS:
            return []
        order = [(len(packets) + turn) % groups for turn in range(groups)]
        made = (
            self._parity(packets[group::groups], groups, last=group == order[-1]) for group in order
        )
        return [one for one in made if one]

    def _parity(self, packets: Sequence[bytes], distance: int, *, last: bool) -> bytes:
        headers = [read_rtp(packet) for packet in packets]
        if any(header is None for header in headers):
            return b""
        known = [header for header in headers if header is not None]
        payloads = [
            packet[header.payload_offset :] for packet, header in zip(packets, known, strict=True)
        ]
        length = reduce(xor, map(len, payloads))
        markers = reduce(xor, (header.marker for header in known))
        group = _GROUP.pack(known[0].sequence, len(packets), distance, markers, length)
        header = rtp_header(
            PARITY_PAYLOAD_TYPE,
            self._sequence,
            known[0].timestamp,
            self._ssrc,
            marker=last,
            numbered=self._numbered,
        )
        self._sequence = (self._sequence + 1) % SEQUENCES
        return header + group + _xor(payloads)


class ParityDecoder:
    """Restores the lost packets of one view; takes packets in any order, also twice or never."""

    def __init__(self, media_ssrc: int) -> None:
        self._ssrc = media_ssrc
        self._media: OrderedDict[tuple[int, int], bytes] = OrderedDict()  # (timestamp, sequence)
        # parity with two or more missing, by each of these
        self._waiting: OrderedDict[tuple[int, int], bytes] = OrderedDict()

    def media(self, packet: bytes) -> list[bytes]:
        """A media packet came: what it lets an earlier parity packet restore."""
        header = read_rtp(packet)
        if header is None or header.payload_type != MEDIA_PAYLOAD_TYPE:
            return []
        key = (header.timestamp, header.sequence)
        _keep(self._media, key, packet, _KEPT_PACKETS)
        waiting = self._waiting.pop(key, None)
        return [] if waiting is None else self.parity(waiting)

    def parity(self, packet: bytes) -> list[bytes]:
        """A parity packet came: the packet that it restores, if exactly one of its group misses."""
        rtp = read_rtp(packet)
        if rtp is None or rtp.payload_type != PARITY_PAYLOAD_TYPE:
            return []
        body = rtp.payload_offset + _GROUP.size
        if len(packet) < body:
            return []
        first, count, distance, markers, length = _GROUP.unpack_from(packet, rtp.payload_offset)
        keys = [(rtp.timestamp, (first + n * distance) % SEQUENCES) for n in range(count)]
        missing = [key for key in keys if key not in self._media]
        if len(missing) > 1:
            for key in missing:
                _keep(self._waiting, key, packet, _KEPT_WAITING)
        if len(missing) != 1:
            return []
        payloads = [packet[body:]]
        for key in keys:
            if key != missing[0]:
                kept = self._media[key]
                known = read_rtp(kept)
                assert known is not None  # only such packets are kept
                payloads.append(kept[known.payload_offset :])
                markers ^= known.marker
                length ^= len(payloads[-1])
        payload = _xor(payloads)
        if length > len(payload):  # no packet of ours
            return []
        timestamp, sequence = missing[0]
        header = rtp_header(
            MEDIA_PAYLOAD_TYPE, sequence, timestamp, self._ssrc, marker=bool(markers & 1)
        )
        restored = header + payload[:length]
        _keep(self._media, missing[0], restored, _KEPT_PACKETS)
        return [restored]


def _keep(
    kept: OrderedDict[tuple[int, int], bytes], key: tuple[int, int], packet: bytes, most: int
) -> None:
    kept[key] = packet
    if len(kept) > most:
        kept.popitem(last=False)


def _xor(payloads: Sequence[bytes]) -> bytes:
    """The XOR of all, as long as the longest."""
    longest = max(map(len, payloads))
    numbers = (int.from_bytes(payload.ljust(longest, b"\0"), "big") for payload in payloads)
    return reduce(xor, numbers).to_bytes(longest, "big")

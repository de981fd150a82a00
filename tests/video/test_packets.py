"""RTP headers, also of packets that GStreamer made or that are broken, and padding."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import IP_UDP_HEADER_BYTES, PacketKind
from tams_app.video.core.packets import (
    Padding,
    identify,
    read_rtp,
    transport_sequence,
    with_transport_sequence,
)
from tests.faults.applications import until
from tests.video.lossy_link import LossyLink
from tests.video.streams import UNREPAIRED, stream

pytestmark = pytest.mark.waiting

SSRC, MTU_BYTES = 0x54430000, 1200
HEADERS_BYTES = IP_UDP_HEADER_BYTES + 12 + 8


def ip_bytes(packets: list[bytes]) -> int:
    return sum(len(packet) + IP_UDP_HEADER_BYTES for packet in packets)


@given(st.integers(HEADERS_BYTES, 100_000))
def test_packets_take_what_was_asked_for_and_none_is_longer_than_the_mtu(size_bytes: int) -> None:
    packets = Padding(SSRC, MTU_BYTES).packets(size_bytes)
    assert ip_bytes(packets) == size_bytes
    assert max(map(len, packets)) <= MTU_BYTES


def test_less_than_the_headers_take_is_a_packet_without_payload_and_nothing_is_none() -> None:
    padding = Padding(SSRC, MTU_BYTES)
    assert [len(packet) for packet in padding.packets(1)] == [HEADERS_BYTES - IP_UDP_HEADER_BYTES]
    assert padding.packets(0) == []


def test_packets_are_numbered_have_room_for_the_session_s_number_and_end_like_a_frame() -> None:
    padding = Padding(SSRC, MTU_BYTES)
    packets = padding.packets(3000) + padding.packets(100)
    headers = [header for packet in packets if (header := read_rtp(packet)) is not None]
    assert [header.sequence for header in headers] == [0, 1, 2, 3]
    assert [header.marker for header in headers] == [False, False, True, True]
    assert transport_sequence(with_transport_sequence(packets[0], 54321)) == 54321
    for packet, header in zip(packets, headers, strict=True):
        assert identify(packet) == (PacketKind.PADDING, 0, 0)
        assert set(packet[header.payload_offset :]) <= {0}


def test_over_sockets_padding_is_told_of_and_the_views_frames_are_what_they_were() -> None:
    link = LossyLink(lambda ordinal, datagram: ordinal != 60)
    with stream(link, UNREPAIRED, feedback=True) as joined:
        joined.sender.pad(5000)  # before the stream: nothing to tell of it
        assert joined.sender.wire_bytes == 0
        joined.push(range(1))
        assert joined.wait_until(lambda: bool(joined.shown))
        for index in range(1, 41):
            joined.push(range(index, index + 1))
            joined.sender.pad(2500)
        assert joined.wait_until(lambda: joined.shown_indices()[-1:] == [40])
        media_bytes = ip_bytes([one for one in link.rtp if kind_of(one) is PacketKind.MEDIA])
        told = joined.arrivals(lambda: len(link.rtp))
        until(lambda: joined.sender.wire_bytes == ip_bytes(link.rtp), "all that was sent")
    padding = [one for one in link.rtp if kind_of(one) is PacketKind.PADDING]
    assert ip_bytes(padding) == 40 * 2500
    assert [transport_sequence(one) for one in link.rtp] == list(range(len(link.rtp)))
    sizes = [len(one) + IP_UDP_HEADER_BYTES for one in link.rtp[: len(told)]]
    assert [one.size_bytes for one in told] == sizes
    assert [place for place, one in enumerate(told) if one.arrived_ns is None] == [60]
    # 1500 kbit/s at 60 frames a second: what padding takes is not taken from the frames
    assert media_bytes > 0.75 * 40 * 1500 * 1000 / 8 / 60


def kind_of(datagram: bytes) -> PacketKind:
    return identify(datagram)[0]


def rtp(payload_type, payload=b"", sources=(), extension=None, marker=False):
    first = 0x80 | len(sources) | (0x10 if extension is not None else 0)
    header = struct.pack("!BBHII", first, payload_type | (marker << 7), 513, 3000, 0x54410000)
    header += b"".join(struct.pack("!I", source) for source in sources)
    if extension is not None:
        header += struct.pack("!HH", 0xBEDE, len(extension) // 4) + extension
    return header + payload


def test_the_fixed_header_is_read():
    header = read_rtp(rtp(96, b"abc", marker=True))
    assert (header.payload_type, header.marker, header.sequence) == (96, True, 513)
    assert (header.timestamp, header.payload_offset) == (3000, 12)
    assert identify(rtp(96, b"abc")) == (PacketKind.MEDIA, 513, 3000)


@pytest.mark.parametrize("sources", [(), (7, 8)])
@pytest.mark.parametrize("extension", [None, b"", b"\x10\x00\x00\x00"])
def test_a_resent_packet_tells_the_number_of_the_original(sources, extension):
    resent = rtp(97, b"\x12\x34rest", sources, extension)
    assert identify(resent) == (PacketKind.REPAIR, 0x1234, 3000)


@pytest.mark.parametrize(
    "datagram",
    [b"", b"\x80\x60", b"\x00" * 20, rtp(96, sources=(1,))[:14], rtp(96, extension=b"1234")[:15]],
)
def test_what_is_no_rtp_is_said_to_be_none_and_carried_as_media(datagram):
    assert read_rtp(datagram) is None
    assert identify(datagram) == (PacketKind.MEDIA, 0, 0)


@given(st.binary(max_size=80))
def test_no_bytes_whatever_break_the_reading(datagram):
    identify(datagram)

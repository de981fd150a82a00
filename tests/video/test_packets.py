"""Reading RTP headers, also of packets that GStreamer made or that are broken."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketKind
from tams_app.video.core.packets import identify, read_rtp

pytestmark = pytest.mark.untimed


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

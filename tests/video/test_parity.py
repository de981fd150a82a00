"""Parity packets: what one lost packet of a group costs is nothing, and no bytes break it."""

from __future__ import annotations

import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tams_app.video.core.packets import (
    MEDIA_PAYLOAD_TYPE,
    PARITY_PAYLOAD_TYPE,
    read_rtp,
    transport_sequence,
    with_transport_sequence,
)
from tams_app.video.core.parity import HEADER_BYTES, ParityDecoder, ViewParity

pytestmark = pytest.mark.untimed

MEDIA_SSRC, PARITY_SSRC = 0x54410000, 0x54420000


def media(sequence: int, payload: bytes, timestamp: int = 3000, marker: bool = False) -> bytes:
    second = MEDIA_PAYLOAD_TYPE | (marker << 7)
    return struct.pack("!BBHII", 0x80, second, sequence % 65536, timestamp, MEDIA_SSRC) + payload


def encoder(groups: int, numbered: bool = False) -> ViewParity:
    made = ViewParity(PARITY_SSRC, numbered)
    made.groups = groups
    return made


@st.composite
def frames(draw: st.DrawFn) -> list[bytes]:
    """The packets of one frame; numbers may wrap, lengths differ, also zero."""
    payloads = draw(st.lists(st.binary(max_size=60), min_size=1, max_size=12))
    first, timestamp = draw(st.integers(0, 65535)), draw(st.integers(0, 2**32 - 1))
    last = len(payloads) - 1
    return [media(first + n, one, timestamp, n == last) for n, one in enumerate(payloads)]


def timestamp_of(packet: bytes) -> int:
    header = read_rtp(packet)
    return header.timestamp


def received(decoder: ParityDecoder, packets: list[bytes]) -> list[bytes]:
    restored = []
    for packet in packets:
        header = read_rtp(packet)
        is_parity = header.payload_type == PARITY_PAYLOAD_TYPE
        restored += decoder.parity(packet) if is_parity else decoder.media(packet)
    return restored


@given(frames(), st.integers(1, 6), st.data())
def test_one_packet_lost_of_each_group_is_restored_bit_for_bit(
    packets: list[bytes], groups: int, data: st.DataObject
) -> None:
    parity = encoder(groups).protect(packets)
    count = len(parity)
    assert count == min(groups, len(packets))
    lost = [data.draw(st.sampled_from(packets[group::count])) for group in range(count)]
    arrived = [packet for packet in packets if packet not in lost]
    assert sorted(received(ParityDecoder(MEDIA_SSRC), arrived + parity)) == sorted(lost)


@given(frames(), st.integers(1, 6), st.data())
def test_as_many_lost_in_a_row_as_there_are_parity_packets_are_restored(
    packets: list[bytes], groups: int, data: st.DataObject
) -> None:
    parity = encoder(groups).protect(packets)
    sent = packets + parity
    start = data.draw(st.integers(0, len(sent) - 1))
    lost = sent[start : start + len(parity)]
    arrived = [packet for packet in sent if packet not in lost]
    restored = received(ParityDecoder(MEDIA_SSRC), arrived)
    assert set(restored) | set(arrived) >= set(packets)


@given(frames(), frames(), st.integers(1, 4), st.data())
def test_order_duplicates_and_late_parity_change_nothing_that_is_restored(
    packets: list[bytes], others: list[bytes], groups: int, data: st.DataObject
) -> None:
    assume(timestamp_of(packets[0]) != timestamp_of(others[0]))
    parity = encoder(groups).protect(packets)
    lost = data.draw(st.sampled_from(packets))
    arrived = [packet for packet in [*packets, *parity, *others, *others] if packet != lost]
    arrived += data.draw(st.lists(st.sampled_from(arrived), max_size=4)) if arrived else []
    shuffled = data.draw(st.permutations(arrived))
    restored = received(ParityDecoder(MEDIA_SSRC), shuffled)
    assert restored.count(lost) == 1
    assert set(restored) <= set(packets)


@given(frames(), st.data())
def test_two_lost_of_one_group_are_not_restored_and_nothing_false_is(
    packets: list[bytes], data: st.DataObject
) -> None:
    header = read_rtp(packets[-1])
    packets += [media(header.sequence + 1, b"x", header.timestamp)]
    parity = encoder(1).protect(packets)
    lost = data.draw(st.lists(st.sampled_from(packets), min_size=2, max_size=2, unique=True))
    arrived = [packet for packet in packets if packet not in lost]
    decoder = ParityDecoder(MEDIA_SSRC)
    assert received(decoder, arrived + parity) == []
    assert decoder.media(lost[0]) == [lost[1]]  # it was only late


@given(st.lists(st.binary(max_size=80)), frames())
def test_no_bytes_whatever_break_it_or_keep_it_from_working(
    hostile: list[bytes], packets: list[bytes]
) -> None:
    protecting, decoder = encoder(1), ParityDecoder(MEDIA_SSRC)
    for datagram in hostile:
        header = struct.pack("!BBHII", 0x80, PARITY_PAYLOAD_TYPE, 1, 3001, PARITY_SSRC)
        for one in (datagram, header + datagram):
            protecting.protect([one])
            decoder.media(one)
            decoder.parity(one)
    assume(timestamp_of(packets[0]) != 3001)
    parity = protecting.protect(packets)
    assert received(decoder, packets[1:] + parity) == packets[:1]


def test_what_is_kept_is_bounded() -> None:
    decoder, protecting = ParityDecoder(MEDIA_SSRC), encoder(1)
    for number in range(3000):
        packets = [media(4 * number + n, b"abc", 90 * number) for n in range(4)]
        received(decoder, packets[:2] + protecting.protect(packets))
    assert len(decoder._media) <= 1024
    assert len(decoder._waiting) <= 64


def test_a_parity_packet_whose_lengths_do_not_add_up_restores_nothing() -> None:
    packets = [media(n, b"abcd") for n in range(2)]
    (parity,) = encoder(1).protect(packets)
    lengths = slice(12 + HEADER_BYTES - 2, 12 + HEADER_BYTES)
    forged = bytearray(parity)
    forged[lengths] = struct.pack("!H", 1 << 12)
    assert received(ParityDecoder(MEDIA_SSRC), [packets[0], bytes(forged)]) == []
    assert received(ParityDecoder(MEDIA_SSRC), [packets[0], parity]) == [packets[1]]


@given(frames(), st.integers(1, 6))
def test_numbered_packets_restore_the_same_and_the_last_one_ends_the_frame(
    packets: list[bytes], groups: int
) -> None:
    parity = encoder(groups, numbered=True).protect(packets)
    numbered = [with_transport_sequence(one, 54321) for one in parity]
    assert [transport_sequence(one) for one in numbered] == [54321] * len(parity)
    headers = [header for one in numbered if (header := read_rtp(one)) is not None]
    assert [header.marker for header in headers] == [False] * (len(parity) - 1) + [True]
    assert received(ParityDecoder(MEDIA_SSRC), packets[1:] + numbered) == packets[:1]

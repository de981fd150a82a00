"""The receiver over real sockets: identity, repair, keyframe requests, failures."""

from __future__ import annotations

import socket

import pytest

from tams_app.config import VideoConfig
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.packets import MEDIA_PAYLOAD_TYPE, media_ssrc
from tams_app.video.core.repair import RepairRule
from tests.video.lossy_link import LossyLink
from tests.video.streams import (
    UNREPAIRED,
    checksum,
    decoded_checksums,
    jitter_counts,
    stream,
)

pytestmark = pytest.mark.waiting

NOTHING_SENT = SentFrames().find


def is_media(datagram: bytes) -> bool:
    return datagram[1] & 0x7F == MEDIA_PAYLOAD_TYPE


def count_requests(compounds: list[bytes], packet_type: int) -> int:
    """RTCP packets of a type within compound packets: 205 NACK, 206 PLI."""
    count = 0
    for compound in compounds:
        position = 0
        while position < len(compound):
            count += compound[position + 1] == packet_type
            position += 4 * (int.from_bytes(compound[position + 2 : position + 4], "big") + 1)
    return count


def test_a_lost_packet_is_asked_for_and_sent_again() -> None:
    lost = []

    def lose_one(ordinal: int, datagram: bytes) -> bool:
        first_time = is_media(datagram) and ordinal == 50
        lost.extend([ordinal] if first_time else [])
        return not first_time

    long_latency = RepairRule(rtx=True, latency_ms=2_000, pli_interval_ms=300.0)
    with stream(LossyLink(lose_one), long_latency) as joined:
        joined.carry(range(40))
        counts = jitter_counts(joined.receiver.decoder)
    assert lost == [50]
    assert min(counts["rtx-count"], counts["rtx-success-count"]) >= 1
    assert counts["num-lost"] == 0
    assert sum(each.keyframe for each in joined.encoded) == 1
    assert joined.exact


def test_an_unrepaired_loss_brings_a_keyframe_request_and_a_whole_frame() -> None:
    link = LossyLink(lambda ordinal, datagram: ordinal not in (40, 44, 48))
    with stream(link, UNREPAIRED) as joined:
        joined.push(range(60))
        assert joined.wait_until(lambda: joined.shown[-1].index == 59)
        counts = jitter_counts(joined.receiver.decoder)
    references = decoded_checksums(joined.encoded)
    assert counts["num-lost"] == 3
    assert count_requests(link.feedback, 206) >= 1
    assert count_requests(link.feedback, 205) == 0  # without RTX nothing is asked for again
    assert all(map(is_media, link.rtp))
    assert [each.keyframe for each in joined.encoded].count(True) >= 2
    assert checksum(joined.shown[-1]) == references[59]


def test_a_request_for_the_first_keyframe_that_gets_lost_is_repeated() -> None:
    link = LossyLink(
        lambda ordinal, datagram: ordinal >= 8,
        keep_feedback=lambda ordinal, datagram: (
            count_requests([datagram], 206) == 0 or count_requests(link.feedback, 206) > 1
        ),
    )
    with stream(link, UNREPAIRED) as joined:
        joined.push(range(60))
        assert joined.wait_until(lambda: bool(joined.shown) and joined.shown[-1].index == 59)
    assert count_requests(link.feedback, 206) >= 2
    assert checksum(joined.shown[-1]) == decoded_checksums(joined.encoded)[59]


@pytest.mark.parametrize("payload_type", [96, 97, 122])
def test_packets_of_strangers_do_not_end_the_stream(payload_type: int) -> None:
    def intrude(first: int) -> None:
        for sequence in range(first, first + 20):
            header = bytes([0x80, payload_type]) + sequence.to_bytes(2, "big") + b"\0\0\0\1"
            for ssrc in range(1, 13):
                packet = header + ssrc.to_bytes(4, "big") + b"\x41" * 50
                link.bring(packet)
            link.bring(b"not RTP at all")

    link = LossyLink()
    with stream(link) as joined:
        intrude(0)
        joined.push(range(10))
        intrude(20)
        joined.push(range(10, 30))
        assert joined.wait_until(lambda: joined.shown_indices()[-1:] == [29])
    assert joined.shown_indices() == list(range(30))


def test_packets_of_another_program_of_this_computer_are_not_taken() -> None:
    """Under the stream's own SSRC, far ahead of it: taken for its own they would end the view."""

    def intrude() -> None:
        ssrc = media_ssrc(VideoConfig(), "eih").to_bytes(4, "big")
        for sequence in (30_000, 30_001, 30_002):
            packet = b"\x80\x60" + sequence.to_bytes(2, "big") + b"\x7f\0\0\0" + ssrc + b"\x41" * 50
            for port in (joined.exits.rtp, joined.exits.reports):
                stranger.sendto(packet, ("127.0.0.1", port))
            goodbye = b"\x81\xcb\0\x01" + ssrc  # RTCP BYE
            for port in (joined.exits.reports, joined.exits.feedback):
                stranger.sendto(goodbye, ("127.0.0.1", port))

    with stream() as joined, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for first in range(0, 60, 10):
            intrude()
            joined.push(range(first, first + 10))
        assert joined.wait_until(lambda: joined.shown_indices()[-1:] == [59])
    assert joined.shown_indices() == list(range(60))

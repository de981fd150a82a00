"""Parity over sockets: lost packets come back without a round trip, and count as sent."""

from __future__ import annotations

from collections import Counter

import pytest

from tams_app.records import IP_UDP_HEADER_BYTES, PacketKind
from tams_app.video.core.packets import identify
from tams_app.video.core.repair import RepairRule
from tests.video.lossy_link import LossyLink
from tests.video.streams import stream

pytestmark = pytest.mark.waiting

FRAMES = 60
# A jitter buffer that waits so long shows that nothing is given up before parity has come.
PROTECTED = RepairRule(False, 1000, 300.0, pli=False, parity=True)


def test_lost_packets_are_restored_bit_for_bit() -> None:
    lost: list[int] = []
    hit: set[int] = set()

    def lose_one_of_every_second_frame(ordinal: int, datagram: bytes) -> bool:
        kind, sequence, timestamp = identify(datagram)
        if kind is not PacketKind.MEDIA or timestamp in hit:
            return True
        hit.add(timestamp)
        if len(hit) % 2 == 0:
            lost.append(sequence)
            return False
        return True

    link = LossyLink(lose_one_of_every_second_frame)
    with stream(link, PROTECTED) as joined:
        joined.parity.groups = 2
        joined.carry(range(FRAMES))
        assert len(lost) >= 20
        sent_bytes = joined.sender.wire_bytes
    assert joined.exact
    kinds = Counter(identify(datagram)[0] for datagram in link.rtp)
    assert kinds[PacketKind.PARITY] >= FRAMES
    assert sent_bytes == sum(len(datagram) + IP_UDP_HEADER_BYTES for datagram in link.rtp)


@pytest.mark.parametrize("end", ["sender", "receiver"])
def test_an_error_in_parity_is_told_of_and_the_frames_pass(end: str, monkeypatch) -> None:
    def broken(*_: object) -> list[bytes]:
        raise ValueError("a broken packet")

    with stream(LossyLink(), PROTECTED) as joined:
        if end == "sender":
            monkeypatch.setattr(joined.parity, "protect", broken)
        else:
            joined.parity.groups = 1
            monkeypatch.setattr(joined.receiver._parity, "parity", broken)
        with pytest.raises(AssertionError):  # as soon as either end has failed
            joined.push(range(30))
        told = getattr(joined, end).poll()
        assert told.startswith(f"the {end} of view eih failed: ")
        assert "a broken packet" in told
        assert joined.wait_until(lambda: len(joined.shown) > 0)

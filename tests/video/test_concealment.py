"""Concealed frames inferred from loss: against the rule and against a real decoder."""

from __future__ import annotations

import struct
from random import Random

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.concealment import concealed_frames
from tams_app.video.packets import identify
from tams_app.video.repair import RepairRule
from tests.video.lossy_link import LossyLink
from tests.video.streams import UNREPAIRED, checksum, decoded_checksums, stream

pytestmark = pytest.mark.waiting

KEYFRAMES = {index: index in (0, 6) for index in range(10)}
SHOWN = {index: 1000 + index * 33 for index in range(10)}


def packets(lost: tuple[int, ...] = (), late: tuple[int, ...] = ()) -> list[PacketRecord]:
    """Two packets a frame; `lost` and `late` name frames whose second packet has that fate."""
    found = []
    for index in range(10):
        for part in range(2):
            wrong = part == 1 and index in lost
            at_ns = SHOWN[index] + 1 if part == 1 and index in late else SHOWN[index] - 20
            found.append(packet(PacketKind.MEDIA, index, part, 0 if wrong else at_ns))
    return found


def packet(kind: PacketKind, index: int, part: int, delivered_ns: int) -> PacketRecord:
    fate = PacketFate.DELIVERED if delivered_ns else PacketFate.LOST
    entered_ns = 900 + index * 33 + part
    sequence = (65530 + 2 * index + part) % 65536
    timestamp = index * 3000 - (index > 0)  # as the payloader truncates
    return PacketRecord(
        "eih", kind, sequence, 1000, entered_ns, entered_ns, delivered_ns, fate, timestamp
    )


def concealed(found: list[PacketRecord], shown: dict[int, int] = SHOWN) -> list[int]:
    return sorted(concealed_frames(KEYFRAMES, found, shown, 30))


def test_without_loss_nothing_is_concealed() -> None:
    assert concealed(packets()) == []


def test_a_loss_conceals_what_follows_up_to_the_next_keyframe() -> None:
    assert concealed(packets(lost=(3,))) == [3, 4, 5]
    assert concealed(packets(lost=(8,))) == [8, 9]


def test_a_keyframe_that_is_incomplete_repairs_nothing() -> None:
    assert concealed(packets(lost=(3, 6))) == [3, 4, 5, 6, 7, 8, 9]
    assert concealed(packets(lost=(0,))) == [0, 1, 2, 3, 4, 5]


def test_a_repair_that_arrives_in_time_leaves_nothing_concealed() -> None:
    assert concealed([*packets(lost=(3,)), packet(PacketKind.REPAIR, 3, 1, SHOWN[3] - 1)]) == []


def test_a_repair_that_comes_after_its_frame_or_a_later_one_was_shown_is_too_late() -> None:
    late = [*packets(lost=(3,)), packet(PacketKind.REPAIR, 3, 1, SHOWN[3] + 1)]
    assert concealed(late) == [3, 4, 5]
    without_3 = {index: at_ns for index, at_ns in SHOWN.items() if index != 3}
    assert concealed(late, without_3) == []
    later = [*packets(lost=(3,)), packet(PacketKind.REPAIR, 3, 1, SHOWN[4] + 1)]
    assert concealed(later, without_3) == [3, 4, 5]
    assert concealed(packets(late=(3,))) == [3, 4, 5]


def test_a_packet_of_another_lap_of_the_sequence_replaces_nothing() -> None:
    other_lap = PacketRecord(
        "eih", PacketKind.MEDIA, 1, 1000, 10**6, 10**6, 10**6, PacketFate.DELIVERED, 90_000_000
    )
    assert concealed([*packets(lost=(3,)), other_lap]) == [3, 4, 5]


def test_packets_that_never_came_to_the_link_are_seen_by_the_gap_they_leave() -> None:
    every = packets()
    tail_of_3 = [one for one in every if one is not every[7]]
    assert concealed(tail_of_3)[0] == 3
    all_of_8 = [one for one in every if one not in every[16:18]]
    assert set(concealed(all_of_8)) >= {8, 9}


VERY_PATIENT = RepairRule(rtx=True, latency_ms=2000, pli_interval_ms=300.0)


def fates_of(link: LossyLink) -> list[PacketRecord]:
    """Of everything that went in; the link keeps the order of what comes out."""
    found, came_out = [], iter([*link.delivered, (0, b"")])
    delivered_ns, next_out = next(came_out)
    for order, data in enumerate(link.rtp):
        kind, sequence, timestamp = identify(data)
        fate, at_ns = PacketFate.LOST, 0
        if data is next_out:
            fate, at_ns = PacketFate.DELIVERED, delivered_ns
            delivered_ns, next_out = next(came_out)
        found.append(
            PacketRecord("eih", kind, sequence, len(data), order, 0, at_ns, fate, timestamp)
        )
    return found


@pytest.mark.parametrize("rule", [UNREPAIRED, VERY_PATIENT])
def test_all_other_frames_are_bit_exact_and_concealed_ones_are_found(rule: RepairRule) -> None:
    """A real stream over a link that jitters and loses 3 % of media and repairs: what is shown as
    index i is the decode of the complete bitstream at i, unless the fates say it is concealed."""

    def keep(ordinal: int, datagram: bytes) -> bool:
        repair = identify(datagram)[0] is PacketKind.REPAIR
        (sequence,) = struct.unpack_from(">H", datagram, 2)
        return ordinal <= 20 or Random(sequence << 1 | repair).random() >= 0.03

    link = LossyLink(keep, 0.01, 0.008, 0.0001)
    with stream(link, rule, fps=30) as joined:
        joined.push(range(110))
        assert joined.wait_until(lambda: joined.shown[-1].index >= 105)
    references = decoded_checksums(joined.encoded)
    shown_ns = {each.index: each.shown_ns for each in joined.shown}
    keyframe_of = {each.index: each.keyframe for each in joined.encoded}
    found = concealed_frames(keyframe_of, fates_of(link), shown_ns, 30) & shown_ns.keys()
    whole = {each.index for each in joined.shown if checksum(each) == references[each.index]}
    assert len(link.rtp) - len(link.delivered) > 5
    assert len(shown_ns) == len(joined.shown) > 60
    assert shown_ns.keys() - found <= whole
    if rule is UNREPAIRED:
        assert len(found - whole) > 3  # but what carried parameter sets again leaves no trace
    else:
        assert len(whole) > 100

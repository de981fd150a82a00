"""Concealed frames inferred from loss: against the rule and against a real decoder."""

from __future__ import annotations

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.core.concealment import concealed_frames, restored_packets
from tams_app.video.core.repair import RepairRule
from tests.video.streams import PATIENT, UNREPAIRED
from tests.video.virtual_time.runs import shared_run

pytestmark = pytest.mark.untimed

KEYFRAMES = {index: index in (0, 6) for index in range(10)}
INDEX_OF = {index * 3000: index for index in (*range(10), 30_000)}
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
    return PacketRecord(
        "eih", kind, sequence, 1000, entered_ns, entered_ns, delivered_ns, fate, index * 3000
    )


def concealed(found: list[PacketRecord], shown: dict[int, int] = SHOWN) -> list[int]:
    return sorted(concealed_frames(KEYFRAMES, found, shown, INDEX_OF))


@pytest.mark.parametrize(
    ("lost", "expected"),
    [((), []), ((3,), [3, 4, 5]), ((8,), [8, 9]), ((3, 6), [*range(3, 10)]), ((0,), [*range(6)])],
)
def test_a_loss_conceals_what_follows_up_to_the_next_complete_keyframe(
    lost: tuple[int, ...], expected: list[int]
) -> None:
    assert concealed(packets(lost=lost)) == expected


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


@pytest.mark.parametrize("rule", [UNREPAIRED, PATIENT])
def test_all_other_frames_are_bit_exact_and_concealed_ones_are_found(rule: RepairRule) -> None:
    """Over a link that jitters, queues and loses: what is shown as index i is the decode of the
    complete bitstream at i, unless the packets say that it is concealed."""
    run = shared_run("queueing", 90, rule)
    references = run.references
    assert len(set(references.values())) == len(references)  # no two frames alike
    shown, found, whole = {each.index for each in run.shown}, run.concealed, run.exact
    assert sum(packet.fate is not PacketFate.DELIVERED for packet in run.packets) > 5
    assert len(shown) == len(run.shown) > 60
    assert shown - found <= whole
    assert {each.index for each in run.shown if each.whole} <= whole
    if rule is UNREPAIRED:
        assert len(found - whole) > 3  # but what carried parameter sets again leaves no trace
        assert len(shown - found) > 20
    else:
        assert len(whole) > 60


# --- which packets parity restored ---------------------------------------------------------------

MEDIA, REPAIR, PARITY = PacketKind.MEDIA, PacketKind.REPAIR, PacketKind.PARITY


def fate(kind: PacketKind, sequence: int, delivered_ns: int, view: str = "eih") -> PacketRecord:
    found = PacketFate.DELIVERED if delivered_ns else PacketFate.LOST
    return PacketRecord(view, kind, sequence, 900, 1, 2, delivered_ns, found, 3000)


def restored(*packets: PacketRecord) -> list[tuple[int, int]]:
    return [(one.sequence, one.delivered_ns) for one in restored_packets(packets)]


def test_one_lost_packet_is_restored_when_the_last_of_its_group_has_come() -> None:
    media = [fate(MEDIA, 65535, 10), fate(MEDIA, 0, 0), fate(MEDIA, 1, 12)]
    assert restored(*media, fate(PARITY, 65535, 14)) == [(0, 14)]
    assert restored(*media, fate(PARITY, 65535, 0)) == []
    assert restored(*media) == []


def test_two_lost_of_a_group_are_not_and_of_two_groups_are() -> None:
    media = [fate(MEDIA, n, at_ns) for n, at_ns in ((7, 10), (8, 0), (9, 0), (10, 13))]
    assert restored(*media, fate(PARITY, 7, 14)) == []
    assert restored(*media, fate(PARITY, 7, 14), fate(PARITY, 8, 15)) == [(9, 14), (8, 15)]


def test_a_resend_lets_parity_restore_the_other_one() -> None:
    media = [fate(MEDIA, 7, 0), fate(MEDIA, 8, 0), fate(REPAIR, 8, 90)]
    assert restored(*media, fate(PARITY, 7, 14)) == [(7, 90)]


def test_other_views_and_complete_frames_restore_nothing() -> None:
    media = [fate(MEDIA, 7, 10), fate(MEDIA, 8, 0, view="gt")]
    assert restored(*media, fate(PARITY, 7, 14)) == []

"""Which packets parity restored, told from the fates of all."""

from __future__ import annotations

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.core.restoration import restored_packets

pytestmark = pytest.mark.untimed

MEDIA, REPAIR, PARITY = PacketKind.MEDIA, PacketKind.REPAIR, PacketKind.PARITY


def packet(kind: PacketKind, sequence: int, delivered_ns: int, view: str = "eih") -> PacketRecord:
    fate = PacketFate.DELIVERED if delivered_ns else PacketFate.LOST
    return PacketRecord(view, kind, sequence, 900, 1, 2, delivered_ns, fate, 3000)


def restored(*packets: PacketRecord) -> list[tuple[int, int]]:
    return [(one.sequence, one.delivered_ns) for one in restored_packets(packets)]


def test_one_lost_packet_is_restored_when_the_last_of_its_group_has_come() -> None:
    media = [packet(MEDIA, 65535, 10), packet(MEDIA, 0, 0), packet(MEDIA, 1, 12)]
    assert restored(*media, packet(PARITY, 65535, 14)) == [(0, 14)]
    assert restored(*media, packet(PARITY, 65535, 0)) == []
    assert restored(*media) == []


def test_two_lost_of_a_group_are_not_and_of_two_groups_are() -> None:
    media = [packet(MEDIA, n, at_ns) for n, at_ns in ((7, 10), (8, 0), (9, 0), (10, 13))]
    assert restored(*media, packet(PARITY, 7, 14)) == []
    assert restored(*media, packet(PARITY, 7, 14), packet(PARITY, 8, 15)) == [(9, 14), (8, 15)]


def test_a_resend_lets_parity_restore_the_other_one() -> None:
    media = [packet(MEDIA, 7, 0), packet(MEDIA, 8, 0), packet(REPAIR, 8, 90)]
    assert restored(*media, packet(PARITY, 7, 14)) == [(7, 90)]


def test_other_views_and_complete_frames_restore_nothing() -> None:
    media = [packet(MEDIA, 7, 10), packet(MEDIA, 8, 0, view="gt")]
    assert restored(*media, packet(PARITY, 7, 14)) == []

"""What the log keeps of what the budget was told."""

from __future__ import annotations

import pytest

from tams_app.recording.topics import Recordable
from tams_app.records import PacketArrival, Reception, UplinkReport, UplinkSummary
from tams_app.runtime.clock import VirtualClock
from tams_app.session.recorders import SessionRecords

pytestmark = pytest.mark.untimed


class Kept:
    """A log that keeps all."""

    def __init__(self) -> None:
        self.items: list[Recordable] = []

    def record(self, item: Recordable) -> None:
        self.items.append(item)


def kept(*reports: UplinkReport) -> list[Recordable]:
    log = Kept()
    records = SessionRecords(VirtualClock(), log)
    for report in reports:
        records.uplink(report)
    return log.items


def test_a_step_is_kept_as_its_sums_and_what_was_newest() -> None:
    arrivals = (
        PacketArrival("eih", 100, 1000, 5_050),
        PacketArrival("gt", 110, 500, None),
        PacketArrival("eih", 120, 200, 5_090),
    )
    receptions = (Reception("gt", 0.25, 80, 3), Reception("eih", 0.0, None, 0))
    assert kept(UplinkReport(700, 9_000, arrivals, receptions)) == [
        UplinkSummary(700, 9_000, 3, 1, 1_200, 120, 20, {"gt": 0.25, "eih": 0.0},
                      {"gt": 80, "eih": None})
    ]  # fmt: skip


def test_queueing_counts_from_the_fastest_packet_of_the_session() -> None:
    items = kept(
        UplinkReport(1, 1, (PacketArrival("eih", 10, 9, 40),)),
        UplinkReport(2, 2, (PacketArrival("eih", 20, 9, 90),)),
        UplinkReport(3, 3, (PacketArrival("eih", 30, 9, 35), PacketArrival("eih", 31, 9, None))),
    )
    queueing = [item.queueing_ns for item in items if isinstance(item, UplinkSummary)]
    assert queueing == [0, 40, 0]


def test_a_step_in_which_all_were_lost_has_no_queueing() -> None:
    (item,) = kept(UplinkReport(1, 1, (PacketArrival("eih", 10, 9, None),)))
    assert isinstance(item, UplinkSummary)
    assert (item.lost, item.newest_sent_ns, item.queueing_ns) == (1, None, None)


def test_a_step_that_told_nothing_is_not_kept() -> None:
    assert kept(UplinkReport(1, 1)) == []

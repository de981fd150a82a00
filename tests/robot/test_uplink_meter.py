"""What the uplink carries, by the fates of packets or by what receivers tell of them."""

from __future__ import annotations

import pytest

from tams_app.records import (
    PacketArrival,
    PacketFate,
    PacketKind,
    PacketRecord,
    Reception,
    UplinkReport,
    UplinkSummary,
)
from tams_app.robot.policy_loop import summary_of
from tams_app.robot.status import WINDOW_NS, UplinkMeter
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.uplink_figures import ReportedPackets, uplink_figures

pytestmark = pytest.mark.untimed


def summary(*reports: UplinkReport) -> list[UplinkSummary]:
    told = ReportedPackets()
    return [summary_of(report, told.step(report.arrivals)) for report in reports]


def arrivals(
    view: str, start_ns: int, count: int, lost: int = 0, queue_ms: int = 0
) -> list[PacketArrival]:
    """Packets of 1000 bytes, one each 10 ms, the first `lost` of which do not arrive."""
    found = []
    for number in range(count):
        sent_ns = start_ns + number * 10 * NS_PER_MS
        arrived_ns = None if number < lost else sent_ns - 7 * NS_PER_S + queue_ms * NS_PER_MS
        found.append(PacketArrival(view, sent_ns, 1000, arrived_ns))
    return found


def test_a_report_is_kept_as_its_sums_and_what_was_newest() -> None:
    told = (
        PacketArrival("eih", 100, 1000, 5_050),
        PacketArrival("gt", 110, 500, None),
        PacketArrival("eih", 120, 200, 5_090),
    )
    receptions = (Reception("gt", 0.25, 80, 3), Reception("eih", 0.0, None, 0))
    assert summary(UplinkReport(700, 9_000, told, receptions)) == [
        UplinkSummary(700, 9_000, 3, 1, 1_200, 120, 20, {"gt": 0.25, "eih": 0.0},
                      {"gt": 80, "eih": None})
    ]  # fmt: skip


def test_queueing_counts_from_the_fastest_packet_of_the_session() -> None:
    found = summary(
        UplinkReport(1, 1, (PacketArrival("eih", 10, 9, 40),)),
        UplinkReport(2, 2, (PacketArrival("eih", 20, 9, 90),)),
        UplinkReport(3, 3, (PacketArrival("eih", 30, 9, 35), PacketArrival("eih", 31, 9, None))),
    )
    assert [one.queueing_ns for one in found] == [0, 40, 0]


def test_a_report_of_nothing_but_losses_has_no_queueing() -> None:
    (found,) = summary(UplinkReport(1, 1, (PacketArrival("eih", 10, 9, None),)))
    assert (found.lost, found.newest_sent_ns, found.queueing_ns) == (1, None, None)


def test_nothing_is_known_before_anything_is_told_nor_long_after() -> None:
    meter = UplinkMeter(("eih", "gt"))
    nothing = uplink_figures((), ("eih", "gt"), WINDOW_NS)
    assert meter.figures(0) == nothing
    meter.report(ReportedPackets().step(arrivals("gt", 0, 10)))
    assert meter.figures(NS_PER_S).loss == 0.0
    assert meter.figures(10 * NS_PER_S) == nothing


def test_a_real_network_is_known_by_what_receivers_tell() -> None:
    meter, told = UplinkMeter(("eih", "gt")), ReportedPackets()
    start_ns = 50 * NS_PER_S
    meter.report(told.step(arrivals("gt", start_ns, 100)))
    meter.report(told.step(arrivals("eih", start_ns + NS_PER_S, 80, lost=20, queue_ms=35)))
    found = meter.figures(start_ns + 2 * NS_PER_S)
    # of the last second: 79 packets of one view and 21 of the other, 8 kbit each
    assert found.sent_kbps == {"eih": 640.0, "gt": 168.0}
    assert found.link_kbps == 808.0
    assert found.loss == pytest.approx(20 / 101)
    assert found.queue_ms == 35.0


def test_where_the_network_is_emulated_what_receivers_tell_is_not_counted_again() -> None:
    meter, told = UplinkMeter(("gt",)), ReportedPackets().step(arrivals("gt", 0, 50))
    meter.report(told)
    fate = PacketRecord("gt", PacketKind.MEDIA, 0, 500, 10, 20, 30, PacketFate.DELIVERED)
    meter.packets([fate])
    meter.report(told)
    assert meter.figures(0).link_kbps == 4.0

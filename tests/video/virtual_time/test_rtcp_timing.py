"""AVPF's rules: when a report may leave."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.virtual.rtcp_timing import RtcpReport, RtcpTiming

pytestmark = pytest.mark.untimed

T_RR_NS = 20 * NS_PER_MS
LONG_NS = NS_PER_S


def timing(seed: int = 1) -> RtcpTiming:
    made = RtcpTiming(Random(seed), T_RR_NS, 10e6)
    made.start(0)
    return made


def run_until(session: RtcpTiming, end_ns: int) -> list[tuple[int, RtcpReport]]:
    reports = []
    while session.next_ns is not None and session.next_ns <= end_ns:
        now_ns = session.next_ns
        if (report := session.step(now_ns)) is not None:
            reports.append((now_ns, report))
    return reports


def run_to_first_regular(session: RtcpTiming) -> int:
    while True:
        now_ns = session.next_ns
        if session.step(now_ns) is not None:
            return now_ns


def test_a_session_is_silent_before_its_first_packet() -> None:
    session = RtcpTiming(Random(1), T_RR_NS, 10e6)
    session.request(0, LONG_NS)
    assert session.next_ns is None


@given(st.integers(0, 1000))
def test_regular_reports_keep_half_to_one_and_a_half_intervals_apart(seed: int) -> None:
    reports = run_until(timing(seed), NS_PER_S)
    assert {kind for _, kind in reports} == {RtcpReport.REGULAR}
    gaps = [after - before for (before, _), (after, _) in pairwise(reports[1:])]
    assert all(0.5 * T_RR_NS <= gap <= 1.5 * T_RR_NS + 5 * NS_PER_MS for gap in gaps)
    assert 15 * NS_PER_MS < sum(gaps) / len(gaps) < 25 * NS_PER_MS


def test_a_request_after_a_regular_report_leaves_at_once_and_a_second_after_the_interval() -> None:
    session = timing()
    run_until(session, 100 * NS_PER_MS)
    last_ns = run_to_first_regular(session)
    session.request(last_ns + 1000, LONG_NS)
    assert session.next_ns == last_ns + 1000
    assert session.step(last_ns + 1000) is RtcpReport.EARLY
    regular_ns = session.next_ns
    session.request(last_ns + 2000, LONG_NS)
    assert last_ns + 500_000 < session.next_ns < regular_ns


def test_an_urgent_second_request_goes_with_the_next_regular_report() -> None:
    session = timing()
    run_until(session, 100 * NS_PER_MS)
    last_ns = run_to_first_regular(session)
    session.request(last_ns + 1000, LONG_NS)
    session.step(last_ns + 1000)
    regular_ns = session.next_ns
    session.request(last_ns + 2000, time_left_ns=0)
    assert session.next_ns == regular_ns
    assert run_until(session, NS_PER_S)[0][1] is RtcpReport.REGULAR


def test_a_request_before_the_first_report_waits_for_it() -> None:
    session = timing()
    first_ns = session.next_ns
    session.request(10, LONG_NS)
    assert session.next_ns == first_ns


@given(
    st.integers(0, 1000),
    st.lists(st.integers(0, 400 * NS_PER_MS), max_size=30),
    st.integers(0, LONG_NS),
)
def test_never_two_early_reports_without_an_interval_between(
    seed: int, times: list[int], patience_ns: int
) -> None:
    session, reports = timing(seed), list[tuple[int, RtcpReport]]()
    for now_ns in sorted(times):
        reports += run_until(session, now_ns)
        session.request(now_ns, patience_ns)
    reports += run_until(session, NS_PER_S)
    early = [
        (one, other) for one, other in pairwise(reports) if one[1] is other[1] is RtcpReport.EARLY
    ]
    # 8 · 100 bytes · 2 members / 500 kbit/s, times 0.5 / 1.21828
    assert all(after[0] - before[0] >= 1_000_000 for before, after in early)
    assert [time for time, _ in reports] == sorted(time for time, _ in reports)


def test_larger_reports_and_more_members_make_the_interval_longer() -> None:
    def second_early_after_ns(members: int, size_bytes: int) -> int:
        session = RtcpTiming(Random(4), T_RR_NS, 10e6)
        session.members = members
        for _ in range(100):
            session.observe(size_bytes)
        session.start(0)
        last_ns = run_to_first_regular(session)
        session.request(last_ns + 1, LONG_NS)
        session.step(last_ns + 1)
        session.request(last_ns + 2, LONG_NS)
        return session.next_ns - last_ns

    assert second_early_after_ns(2, 60) < second_early_after_ns(2, 120)
    assert second_early_after_ns(2, 120) < second_early_after_ns(3, 120)

"""When a report may leave, what it carries, what a sender obeys, and what it still has."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketKind
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.virtual.rtcp_sessions import (
    Feedback,
    ReceiverSession,
    RtcpReport,
    RtcpTiming,
    SenderSession,
)
from tams_app.video.virtual.sender import SentPackets

pytestmark = pytest.mark.untimed
T_RR_NS = 20 * NS_PER_MS
LONG_NS = NS_PER_S


def receiver(rtx: bool = True) -> ReceiverSession:
    session = ReceiverSession(Random(1), rtx)
    session.received(0, PacketKind.MEDIA)
    next_feedback(session)
    return session


def next_feedback(session: ReceiverSession) -> Feedback:
    while True:
        feedback = session.step(session.timing.next_ns)
        if feedback is not None:
            return feedback


def asking(at_ns: int, pli: bool = True, transit_ns: int | None = None) -> Feedback:
    return Feedback(at_ns - 80 * NS_PER_MS, (), pli, 100, transit_ns)


def test_what_was_asked_leaves_once_and_in_order() -> None:
    session = receiver()
    now_ns = (session.timing.next_ns or 0) - 1
    session.ask_again(now_ns, 7, 50)
    session.ask_again(now_ns, 9, 60)
    session.ask_keyframe(now_ns)
    feedback = next_feedback(session)
    assert (feedback.sent_ns, feedback.nacks, feedback.pli) == (now_ns, (7, 9), True)
    assert feedback.report_transit_ns is None  # an early report says nothing of reception
    later = next_feedback(session)
    assert (later.nacks, later.pli) == ((), False)


def test_sizes_are_those_that_rtpsession_sends() -> None:
    session = receiver()
    assert next_feedback(session).size_bytes == 112
    session.ask_again((session.timing.next_ns or 0) - 1, 7, 50)
    assert next_feedback(session).size_bytes == 92
    session.ask_keyframe((session.timing.next_ns or 0) - 1)
    feedback = next_feedback(session)
    assert feedback.size_bytes in (88, 124)  # early, or with the next regular report
    session.received(0, PacketKind.REPAIR)
    while (feedback := next_feedback(session)).size_bytes < 112:
        pass
    assert feedback.size_bytes == 136
    session.received(0, PacketKind.PADDING)
    while (feedback := next_feedback(session)).size_bytes < 136:
        pass
    assert feedback.size_bytes == 160


def test_one_entry_asks_for_seventeen_packets_also_where_numbers_wrap() -> None:
    session = receiver()
    now_ns = (session.timing.next_ns or 0) - 1
    for sequence in (65530, 65535, 4, 11):
        session.ask_again(now_ns, sequence, 50)
    # the span from 65530 is 6 + 11 = 17 > 16: a second entry for 11
    assert next_feedback(session).size_bytes == 28 + 8 + 40 + 12 + 2 * 4


def test_a_regular_report_leaves_out_what_would_come_too_late() -> None:
    session = receiver()
    now_ns = (session.timing.next_ns or 0) - 1
    session.ask_again(now_ns, 5, 100)
    next_feedback(session)  # the early one is spent
    session.ask_again(now_ns + 1, 6, 0)
    session.ask_again(now_ns + 2, 8, 10_000)
    asked: list[int] = []
    while 8 not in asked:
        asked += next_feedback(session).nacks
    assert asked == [8]


def test_the_report_of_the_sender_is_answered_in_regular_reports() -> None:
    session = receiver()
    session.received_report(90 * NS_PER_MS, 108)
    assert next_feedback(session).report_transit_ns == 90 * NS_PER_MS


def test_a_keyframe_request_within_two_round_trips_is_ignored() -> None:
    session = SenderSession(Random(1), rtx=False)
    transit_ns = 100 * NS_PER_MS  # there 100, back 80: 180 ms
    assert session.received(1_000 * NS_PER_MS, asking(1_000 * NS_PER_MS, transit_ns=transit_ns))
    assert not session.received(1_355 * NS_PER_MS, asking(1_355 * NS_PER_MS))
    assert session.received(1_361 * NS_PER_MS, asking(1_361 * NS_PER_MS))


def test_without_a_round_trip_every_keyframe_request_is_obeyed_and_only_a_request() -> None:
    session = SenderSession(Random(1), rtx=False)
    assert not session.received(1000, asking(1000, pli=False))
    assert session.received(1000, asking(1000))
    assert session.received(1001, asking(1001))


def test_a_sender_reports_for_each_stream() -> None:
    def sizes(rtx: bool, *sent: PacketKind) -> list[int]:
        session = SenderSession(Random(1), rtx)
        for kind in (PacketKind.MEDIA, *sent):
            session.sent(0, kind)
        while True:
            if reports := session.step(session.timing.next_ns):
                return reports

    assert sizes(rtx=False) == [108]
    assert sizes(rtx=True) == [108, 88]
    assert sizes(True, PacketKind.REPAIR) == [108, 108]
    assert sizes(False, PacketKind.PARITY, PacketKind.PADDING) == [108, 108, 108]


def test_packets_are_kept_for_their_time_and_no_longer() -> None:
    history = SentPackets(1000)
    history.keep(1, 0, b"one")
    history.keep(2, 90_000, b"two")
    assert history.find(1) == b"one"
    history.keep(3, 90_001, b"three")
    assert (history.find(1), history.find(2), history.find(4)) == (None, b"two", None)


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

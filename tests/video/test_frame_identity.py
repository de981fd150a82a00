"""Capture ↔ RTP timestamp ↔ PTS, exactly, at whatever times frames come."""

from __future__ import annotations

from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import (
    RTP_CLOCK_HZ,
    RtpTimes,
    SentFrame,
    SentFrames,
    rtp_timestamp,
)

pytestmark = pytest.mark.untimed

# a camera that slows down, misses frames, jitters, or is away for a minute
between_captures_ns = st.one_of(
    st.integers(10 * NS_PER_MS, 200 * NS_PER_MS), st.integers(0, 60 * NS_PER_S)
)
captures_ns = st.lists(between_captures_ns, min_size=1, max_size=40).map(
    lambda steps: list(accumulate(steps, initial=5 * NS_PER_S))
)


def send(times_ns: list[int]) -> tuple[SentFrames, list[int]]:
    """A stream of frames captured at these times; their presentation times [ns]."""
    sent = SentFrames()
    return sent, [sent.add(SentFrame(2 * n, t_ns, t_ns + 7)) for n, t_ns in enumerate(times_ns)]


@given(captures_ns)
def test_a_timestamp_finds_the_frame_it_was_made_for(times_ns: list[int]) -> None:
    sent, pts_ns = send(times_ns)
    assert [sent.find(rtp_timestamp(each)) for each in pts_ns] == [
        SentFrame(2 * n, t_ns, t_ns + 7) for n, t_ns in enumerate(times_ns)
    ]


@given(captures_ns)
def test_timestamps_count_from_the_first_capture_and_only_grow(times_ns: list[int]) -> None:
    _, pts_ns = send(times_ns)
    ticks = [rtp_timestamp(each) for each in pts_ns]
    assert ticks[0] == 0
    assert ticks == sorted(set(ticks))
    if all(after - before >= NS_PER_MS for before, after in pairwise(times_ns)):
        true = [(t_ns - times_ns[0]) * RTP_CLOCK_HZ / NS_PER_S for t_ns in times_ns]
        assert ticks == pytest.approx(true, abs=0.501)


@given(captures_ns, st.data(), st.integers(0, 10**13))
def test_a_receiver_knows_every_frame_from_any_first_packet(
    times_ns: list[int], data: st.DataObject, receiver_offset_ns: int
) -> None:
    sent, pts_ns = send(times_ns)
    stamps = [rtp_timestamp(each) for each in pts_ns]
    first = data.draw(st.integers(0, len(stamps) - 1))

    def receiver_pts_ns(stamp: int) -> int:
        return receiver_offset_ns + (stamp - stamps[first]) * NS_PER_S // RTP_CLOCK_HZ

    times = RtpTimes(receiver_pts_ns(stamps[first]), stamps[first])
    for number, stamp in enumerate(stamps):
        found = sent.find(times.timestamp(receiver_pts_ns(stamp)))
        assert found.index == 2 * number


def test_what_was_never_sent_or_long_ago_is_not_found() -> None:
    sent, pts_ns = send([n * NS_PER_S // 30 for n in range(700)])
    assert sent.find(rtp_timestamp(pts_ns[-1]) + 1) is None
    assert sent.find(rtp_timestamp(pts_ns[0])) is None
    assert sent.find(rtp_timestamp(pts_ns[-300])) is not None  # ten seconds at 30 a second


def test_timestamps_wrap_after_13_hours_and_still_find_their_frame() -> None:
    sent, pts_ns = send([0, 14 * 3600 * NS_PER_S])
    stamp = rtp_timestamp(pts_ns[1])
    assert stamp < 14 * 3600 * RTP_CLOCK_HZ
    found = sent.find(stamp)
    assert found.index == 2


@given(
    first=st.integers(0, 2**33),
    steps=st.lists(st.integers(900, 90_000 * 3600), min_size=1, max_size=20),
    restart=st.integers(0, 19),
)
def test_a_restart_of_the_pts_is_seen_and_measured_through_wrapping_timestamps(
    first: int, steps: list[int], restart: int
) -> None:
    times = RtpTimes(NS_PER_S, first % 2**32)
    ticks = missing_ns = 0
    for order, step in enumerate(steps):
        ticks += step
        true_ns = NS_PER_S + ticks * NS_PER_S // RTP_CLOCK_HZ
        if order == restart:
            missing_ns = true_ns - NS_PER_S
        assert times.follow(true_ns - missing_ns, (first + ticks) % 2**32) == missing_ns
        assert times.timestamp(true_ns) == (first + ticks) % 2**32


def test_rounding_is_no_restart() -> None:
    times = RtpTimes(0, 0)
    for ticks in range(1, 100_000, 997):
        assert times.follow(ticks * NS_PER_S // RTP_CLOCK_HZ - 11_111, ticks) == 0

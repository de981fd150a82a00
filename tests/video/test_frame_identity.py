"""Capture index ↔ PTS ↔ RTP timestamp, exactly."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_S
from tams_app.video.frame_identity import (
    RTP_CLOCK_HZ,
    FrameIdentity,
    index_of_pts,
    index_of_rtp_timestamp,
    pts_of_index,
)

pytestmark = pytest.mark.untimed

frame_rates = st.integers(5, 60)
indices = st.integers(0, 1_400_000)  # 13 hours at 30 per second


def rtp_timestamp_of(pts_ns: int) -> int:
    """As the payloader makes it: truncated."""
    return pts_ns * RTP_CLOCK_HZ // NS_PER_S


@given(indices, frame_rates)
def test_an_index_survives_the_way_through_pts(index: int, fps: int) -> None:
    assert index_of_pts(pts_of_index(index, fps), fps) == index


@given(indices, frame_rates)
def test_an_index_survives_the_truncated_rtp_timestamp(index: int, fps: int) -> None:
    assert index_of_rtp_timestamp(rtp_timestamp_of(pts_of_index(index, fps)), fps) == index


@given(
    first=st.integers(0, 100_000),
    others=st.lists(st.integers(-20, 100_000), max_size=20),
    fps=frame_rates,
    receiver_offset_ns=st.integers(0, 10**13),
)
def test_every_frame_is_known_from_any_first_packet(
    first: int, others: list[int], fps: int, receiver_offset_ns: int
) -> None:
    def receiver_pts(index: int) -> int:
        ticks = rtp_timestamp_of(pts_of_index(index, fps)) - first_timestamp
        return receiver_offset_ns + ticks * NS_PER_S // RTP_CLOCK_HZ

    first_timestamp = rtp_timestamp_of(pts_of_index(first, fps))
    identity = FrameIdentity(fps, receiver_pts(first), first_timestamp)
    for index in [first, *(max(0, first + other) for other in others)]:
        assert identity.index(receiver_pts(index)) == index


@given(
    first=st.integers(0, 2**33),
    steps=st.lists(st.integers(1, 90_000 * 3600), min_size=1, max_size=20),
    restart=st.integers(0, 19),
    fps=frame_rates,
)
def test_a_restart_of_the_pts_is_seen_and_measured_through_wrapping_timestamps(
    first: int, steps: list[int], restart: int, fps: int
) -> None:
    identity = FrameIdentity(fps, NS_PER_S, first % 2**32)
    ticks = missing_ns = 0
    for order, step in enumerate(steps):
        ticks += step
        true_ns = NS_PER_S + ticks * NS_PER_S // RTP_CLOCK_HZ
        if order == restart:
            missing_ns = true_ns - NS_PER_S
        expected_ns = missing_ns if 2 * fps * missing_ns >= NS_PER_S else 0
        assert identity.follow(true_ns - missing_ns, (first + ticks) % 2**32) == expected_ns


def test_rounding_of_timestamps_is_no_restart() -> None:
    identity = FrameIdentity(30, 0, 0)
    for index in range(1, 1000):
        pts_ns = pts_of_index(index, 30)
        assert identity.follow(pts_ns - 11_111, rtp_timestamp_of(pts_ns)) == 0

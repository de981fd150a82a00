"""Capture index ↔ PTS ↔ RTP timestamp, exactly."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tams_app.clock import NS_PER_S
from tams_app.video.frame_identity import (
    RTP_CLOCK_HZ,
    FrameIdentity,
    index_of_pts,
    index_of_rtp_timestamp,
    pts_of_index,
)

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
def test_every_picture_is_known_from_any_first_packet(
    first: int, others: list[int], fps: int, receiver_offset_ns: int
) -> None:
    def receiver_pts(index: int) -> int:
        ticks = rtp_timestamp_of(pts_of_index(index, fps)) - first_timestamp
        return receiver_offset_ns + ticks * NS_PER_S // RTP_CLOCK_HZ

    first_timestamp = rtp_timestamp_of(pts_of_index(first, fps))
    identity = FrameIdentity(fps, receiver_pts(first), first_timestamp)
    for index in [first, *(max(0, first + other) for other in others)]:
        assert identity.index(receiver_pts(index)) == index

"""Which frames count as whole, by the packets that a depayloader met."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.video.core.receiver import WholeChain, has_idr

pytestmark = pytest.mark.untimed

SPS, PPS, SEI = b"\0\0\0\4\x67abc", b"\0\0\0\3\x68ab", b"\0\0\0\4\x06\x65\x65\x65"
IDR, DELTA = b"\0\0\0\4\x65abc", b"\0\0\0\4\x41\x65\x65\x65"


def test_before_the_first_keyframe_nothing_is_whole() -> None:
    chain = WholeChain()
    assert not chain.access_unit(0, has_idr=False, has_end=True)
    assert chain.access_unit(3000, has_idr=True, has_end=True)
    assert chain.access_unit(6000, has_idr=False, has_end=True)


@pytest.mark.parametrize("lost_ahead", [True, False], ids=["gap before it", "end missing"])
def test_a_loss_breaks_the_chain_up_to_the_next_complete_keyframe(lost_ahead: bool) -> None:
    chain = WholeChain()
    chain.access_unit(0, has_idr=True, has_end=True)
    if lost_ahead:
        chain.gap(6000)
        assert not chain.unbroken, "at once"
    assert not chain.access_unit(6000, has_idr=False, has_end=lost_ahead)
    assert not any(chain.access_unit(9000 + 3000 * n, False, True) for n in range(50))
    chain.gap(300_000)
    assert not chain.access_unit(300_000, has_idr=True, has_end=True), "a keyframe in parts"
    assert chain.access_unit(303_000, has_idr=True, has_end=True)


def test_the_remains_of_a_frame_do_not_stand_for_what_follows_the_gap() -> None:
    """The depayloader hands out what it had of the first when the second begins."""
    chain = WholeChain()
    chain.gap(3000)
    assert not chain.access_unit(0, has_idr=True, has_end=False)
    assert not chain.access_unit(3000, has_idr=True, has_end=True)


def test_what_is_left_of_a_keyframe_makes_none_of_the_frame_it_is_handed_out_with() -> None:
    """Its parameter sets come with the next frame's slices when its own were lost."""
    chain = WholeChain()
    chain.gap(0)
    assert not chain.access_unit(3000, has_idr=True, has_end=True)


def test_a_keyframe_is_what_has_a_slice_that_needs_no_other_frame() -> None:
    assert has_idr(SPS + PPS + SEI + IDR)
    assert not has_idr(SPS + PPS + SEI + DELTA)
    assert not has_idr(b"")
    assert not has_idr(b"\0\0\0\4")
    assert not has_idr(b"\0\0\0\0" * 5), "a NAL unit of no bytes"


@given(
    st.lists(
        st.tuples(
            st.integers(1, 4), st.sampled_from([False] * 5 + [True]), st.sets(st.integers(0, 3))
        ),
        max_size=60,
    )
)
def test_a_frame_is_whole_only_if_each_packet_since_a_keyframes_first_is_there(
    frames: list[tuple[int, bool, set[int]]],
) -> None:
    """Frames of packets, each a slice of its own: the most that a depayloader can make of them."""
    chain, gap, remains = WholeChain(), False, []
    truly_whole = {}
    held = False
    for index, (count, keyframe, lost) in enumerate(frames):
        missing = lost & set(range(count))
        held = not missing and (keyframe or held)
        truly_whole[index] = held
        for number in range(count):
            if number in missing:
                gap = True
                continue
            if gap:
                gap = False
                chain.gap(3000 * index)
            if remains and remains[0] != index:  # a new picture ends the one before
                assert not chain.access_unit(3000 * remains[0], remains[1], has_end=False)
                remains = []
            remains = [index, keyframe]
            if number == count - 1:
                remains = []
                assert chain.access_unit(3000 * index, keyframe, True) <= truly_whole[index]

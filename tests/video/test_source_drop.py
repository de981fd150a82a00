"""Whole frames are left out when the target cannot pay for them."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_S
from tams_app.video.core.rate_control import SourceDrop

pytestmark = pytest.mark.untimed


FRAME_NS = NS_PER_S // 30


def kept_of(target_kbps: float, frames: int, usual_ns: int = FRAME_NS) -> list[bool]:
    drop = SourceDrop(80.0)
    return [drop.keep(target_kbps, usual_ns) for _ in range(frames)]


@given(st.floats(80.0, 20_000.0))
def test_a_target_at_or_above_the_threshold_drops_nothing(target_kbps: float) -> None:
    assert all(kept_of(target_kbps, 100))


def test_half_the_threshold_keeps_every_second_frame() -> None:
    assert kept_of(40.0, 6) == [True, False, True, False, True, False]


@given(st.floats(14.0, 80.0))
def test_frames_that_are_rare_need_not_be_dropped(target_kbps: float) -> None:
    assert all(kept_of(target_kbps, 50, usual_ns=NS_PER_S // 5))


def test_frames_that_come_twice_as_often_are_dropped_at_twice_the_target() -> None:
    assert kept_of(80.0, 6, usual_ns=NS_PER_S // 60) == [True, False, True, False, True, False]


@given(st.floats(1.0, 80.0))
def test_kept_frames_have_the_bits_of_the_threshold(target_kbps: float) -> None:
    kept = sum(kept_of(target_kbps, 400))
    assert abs(kept - 400 * target_kbps / 80.0) <= 2


@given(st.floats(20.0, 80.0))
def test_kept_frames_are_spread_evenly(target_kbps: float) -> None:
    kept = [index for index, keep in enumerate(kept_of(target_kbps, 400)) if keep]
    gaps = {after - before for before, after in pairwise(kept[1:])}
    assert max(gaps) - min(gaps) <= 1


@given(st.lists(st.floats(0.0, 200.0), min_size=1, max_size=200))
def test_saved_credit_never_exceeds_one_frame(targets_kbps: list[float]) -> None:
    drop = SourceDrop(80.0)
    for target_kbps in targets_kbps:
        drop.keep(target_kbps, FRAME_NS)
    after = [drop.keep(0.0, FRAME_NS) for _ in range(5)]
    assert sum(after) <= 1


def test_no_target_keeps_only_the_first_frame() -> None:
    assert kept_of(0.0, 50) == [True] + [False] * 49

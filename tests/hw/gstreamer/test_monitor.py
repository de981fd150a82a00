"""Freeze detection and the measures of a camera, in virtual time."""

from __future__ import annotations

import pytest

from hw.gstreamer.monitor import (
    REMEMBERED,
    REPETITION_NS,
    START_TIMEOUT_NS,
    FrameStatus,
    FreezeWatch,
)
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

PERIOD_NS = NS_PER_S // 30
OPENED_NS = 7 * NS_PER_S


@pytest.fixture
def watch() -> FreezeWatch:
    watch = FreezeWatch(noisy=True)
    watch.opened(OPENED_NS)
    return watch


def test_a_camera_is_silent_half_a_second_after_its_last_frame_later_where_it_was_just_opened(
    watch: FreezeWatch,
) -> None:
    assert watch.silent_from_ns() == OPENED_NS + START_TIMEOUT_NS
    watch.frame(OPENED_NS + 900 * NS_PER_MS, b"a")
    assert watch.silent_from_ns() == OPENED_NS + 1400 * NS_PER_MS


def test_frames_that_differ_in_one_bit_are_seen(watch: FreezeWatch) -> None:
    for number in range(90):
        frame = b"same" * 100 + bytes([number])
        assert watch.frame(OPENED_NS + number * PERIOD_NS, frame) is FrameStatus.NEW


def test_a_frame_that_comes_again_is_left_out_at_once(watch: FreezeWatch) -> None:
    assert watch.frame(OPENED_NS, b"a") is FrameStatus.NEW
    assert watch.frame(OPENED_NS + PERIOD_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(OPENED_NS + 2 * PERIOD_NS, b"b") is FrameStatus.NEW
    assert watch.frame(OPENED_NS + 3 * PERIOD_NS, b"a") is FrameStatus.REPEATED


@pytest.mark.parametrize("buffers", [2, 4, REMEMBERED])
def test_old_buffers_in_turn_are_left_out_and_then_a_frozen_sensor(
    watch: FreezeWatch, buffers: int
) -> None:
    sights = [
        watch.frame(OPENED_NS + number * PERIOD_NS, bytes([number % buffers]))
        for number in range(60)
    ]
    assert set(sights[:buffers]) == {FrameStatus.NEW}
    assert set(sights[buffers:30]) == {FrameStatus.REPEATED}
    assert sights[-1] is FrameStatus.FROZEN


def test_no_new_frame_for_more_than_a_second_is_a_frozen_sensor(watch: FreezeWatch) -> None:
    at = OPENED_NS
    assert watch.frame(at, b"a") is FrameStatus.NEW
    assert watch.frame(at + REPETITION_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(at + REPETITION_NS + 1, b"a") is FrameStatus.FROZEN
    assert REPETITION_NS == NS_PER_S


def test_reopening_does_not_make_the_same_frame_a_new_one(watch: FreezeWatch) -> None:
    for number in range(60):
        watch.frame(OPENED_NS + number * PERIOD_NS, b"a")
    reopened_ns = OPENED_NS + 3 * NS_PER_S
    watch.opened(reopened_ns)
    # nor one that is left over from before a reason to close the camera again at once
    assert watch.frame(reopened_ns + PERIOD_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(reopened_ns + REPETITION_NS + 1, b"a") is FrameStatus.FROZEN
    assert watch.frame(reopened_ns + REPETITION_NS + PERIOD_NS, b"b") is FrameStatus.NEW

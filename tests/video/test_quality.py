"""What became of each captured frame: exactly one fate, and the right images to compare."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.records import TaskRegion
from tams_app.units import NS_PER_MS
from tams_app.video.core.quality import Fate, Scorer, ViewQuality
from tams_app.video.core.ssim import FrameMoments, Luma, similarity, ssim

pytestmark = pytest.mark.untimed

FRAME_NS = 33 * NS_PER_MS


def luma(seed: int) -> Luma:
    return np.random.default_rng(seed).integers(0, 255, (24, 32), dtype=np.uint8)


def captured_at(index: int) -> int:
    return 1_000_000_000 + index * FRAME_NS


def play(
    shown: dict[int, int], frames: int, window_frames: int = 90, end_ns: int | None = None
) -> list[Fate]:
    """Fates of `frames` captures of which some are shown so many ns after their capture.

    Captures have lumas of seed index, shown images of 1000 + index.
    """
    quality = ViewQuality("gt", window_frames)
    events = [(captured_at(index), 0, index) for index in range(frames)]
    events += [(captured_at(index) + delay, 1, index) for index, delay in shown.items()]
    fates: list[Fate] = []
    for t_ns, is_shown, index in sorted(events):
        if is_shown:
            fates += quality.shown(index, t_ns, luma(1000 + index))
        else:
            fates += quality.captured(index, t_ns, luma(index))
    last_ns = max(t_ns for t_ns, _, _ in events)
    return fates + quality.finish(last_ns if end_ns is None else end_ns)


def same(image: object, expected: Luma) -> bool:
    return np.array_equal(getattr(image, "luma", None), expected)


def test_live_looks_at_what_the_screen_showed_of_a_frame_that_is_corrected() -> None:
    asked: list[tuple[int, int]] = []

    def present(shown: Luma, capture_ns: int, now_ns: int) -> Luma:
        asked.append((capture_ns, now_ns))
        return 255 - shown

    quality = ViewQuality("eih", correct=present)
    fates: list[Fate] = []
    for index in range(6):
        fates += quality.captured(index, captured_at(index), luma(index))
        fates += quality.shown(index, captured_at(index) + NS_PER_MS, luma(1000 + index))
    assert fates[0].on_screen is None
    for index in range(1, 6):
        assert same(fates[index].on_screen, 255 - luma(1000 + index - 1))
        assert same(fates[index].shown, luma(1000 + index))
        assert same(fates[index].stand_in, luma(1000 + index))
    assert asked == [(captured_at(index), captured_at(index + 1)) for index in range(5)]


def test_a_frame_whose_image_or_capture_is_not_known_is_not_corrected() -> None:
    def present(_shown: Luma, _capture_ns: int, _now_ns: int) -> Luma:
        raise AssertionError

    quality = ViewQuality("eih", correct=present)
    quality.shown(7, captured_at(0) - NS_PER_MS, luma(1))  # of no capture here
    (first,) = quality.captured(8, captured_at(0), luma(2)) or quality.finish(captured_at(1))
    assert same(first.on_screen, luma(1))
    quality = ViewQuality("eih", correct=present)
    quality.captured(0, captured_at(0), luma(0))
    quality.shown(0, captured_at(0) + NS_PER_MS, None)
    quality.captured(1, captured_at(1), luma(1))
    (second,) = quality.finish(captured_at(2))
    assert second.on_screen.luma is None


def test_an_image_that_stays_for_more_than_200_ms_is_a_freeze() -> None:
    six = play(dict.fromkeys([0, 1, 7, 8], FRAME_NS), 9)  # 198 ms
    assert not any(fate.record.frozen for fate in six)
    seven = play(dict.fromkeys([0, 1, 8, 9], FRAME_NS), 10)  # 231 ms
    assert [fate.record.index for fate in seven if fate.record.frozen] == list(range(2, 9))


def test_a_freeze_lasts_until_the_end() -> None:
    fates = play({0: FRAME_NS}, 5, end_ns=captured_at(8))
    assert [fate.record.frozen for fate in fates] == [False, True, True, True, True]


def test_the_window_bounds_what_is_kept_and_a_later_image_changes_nothing() -> None:
    quality = ViewQuality("gt", window_frames=5)
    quality.captured(0, captured_at(0), luma(0))
    quality.shown(0, captured_at(0) + 1, luma(1000))
    fates = [
        fate
        for index in range(1, 50)
        for fate in quality.captured(index, captured_at(index), luma(index))
    ]
    assert [fate.record.index for fate in fates] == list(range(1, 45))
    assert all(fate.record.shown_ns is None and same(fate.stand_in, luma(1000)) for fate in fates)
    assert fates[-1].record.frozen
    assert quality.shown(3, captured_at(50), luma(1003)) == []
    assert len(quality._pending) == 5


def test_images_shown_without_captures_do_not_pile_up() -> None:
    quality = ViewQuality("gt", window_frames=5)
    quality.captured(0, captured_at(0), luma(0))
    for index in range(1, 100):
        quality.shown(index, captured_at(index), luma(index))
    assert len(quality._history) <= 5


@settings(max_examples=40)
@given(
    shown=st.dictionaries(st.integers(0, 29), st.just(0), max_size=30),
    delays=st.lists(
        st.integers(1, 8 * FRAME_NS) | st.sampled_from((FRAME_NS, 2 * FRAME_NS)),
        min_size=30,
        max_size=30,
    ),
    window=st.integers(10, 40),
)
def test_every_captured_frame_has_one_fate_as_defined(
    shown: dict[int, int], delays: list[int], window: int
) -> None:
    """Against the definitions taken literally over the whole run; decoders keep the order."""
    at, latest = {}, 0
    for index in sorted(shown):
        latest = max(latest + 1, captured_at(index) + delays[index])
        at[index] = latest
    fates = play({index: t - captured_at(index) for index, t in at.items()}, 30, window)
    assert [fate.record.index for fate in fates] == list(range(30))
    for fate in fates:
        assert fate.record.shown_ns == at.get(fate.record.index)
        up_to = [index for index in at if index <= fate.record.index]
        stand_in = luma(1000 + max(up_to)) if up_to else None
        assert same(fate.captured, luma(fate.record.index))
        assert same(fate.stand_in, stand_in) if up_to else fate.stand_in is None
        assert fate.shown is (fate.stand_in if fate.record.index in at else None)
        on_screen = [index for index, t in at.items() if t <= fate.record.capture_ns]
        assert (fate.on_screen is None) == (not on_screen)
        if on_screen:
            assert same(fate.on_screen, luma(1000 + max(on_screen)))
        age_ns = fate.record.capture_ns - captured_at(max(on_screen)) if on_screen else None
        assert fate.record.age_ns == age_ns


def expected(one: int, other: int) -> float:
    return ssim(FrameMoments.of(luma(one)), FrameMoments.of(luma(other)))


def test_the_three_scores_are_those_of_the_definitions() -> None:
    scorer = Scorer()
    shown = dict.fromkeys([*range(10), *range(15, 30)], 70 * NS_PER_MS)
    scores = [scorer.score(fate) for fate in play(shown, 30)]
    assert scores[20].received == pytest.approx(expected(20, 1020))
    assert scores[20].delivered == scores[20].received
    assert scores[20].live == pytest.approx(expected(20, 1017))
    assert (scores[12].received, scores[12].shown_ns) == (None, None)
    assert scores[12].delivered == pytest.approx(expected(12, 1009))
    assert scores[12].live == pytest.approx(expected(12, 1009))
    assert scores[0].live is None


def test_each_score_is_told_of_the_tasks_region_too() -> None:
    quality, scorer = ViewQuality("gt"), Scorer()
    region = TaskRegion(16.0, 12.0, 4.0)
    fates = quality.captured(0, captured_at(0), luma(0))
    fates += quality.shown(0, captured_at(1) - 1, luma(1000))
    fates += quality.captured(1, captured_at(1), luma(1), region)
    fates += quality.captured(2, captured_at(2), luma(2))
    fates += quality.shown(1, captured_at(2) + 1, luma(1001))
    first, second = (scorer.score(fate) for fate in fates)
    assert (first.task_received, first.task_delivered, first.task_live) == (None, None, None)

    def within(one: int, other: int) -> float | None:
        return similarity(FrameMoments.of(luma(one)), FrameMoments.of(luma(other)), region).task

    assert second.task_received == second.task_delivered == within(1, 1001)
    assert second.task_live == within(1, 1000)
    assert None not in (second.task_live, second.task_received)


def test_missing_images_leave_their_scores_out_and_nothing_else() -> None:
    quality = ViewQuality("gt")
    quality.captured(0, captured_at(0), luma(0))
    quality.captured(1, captured_at(1), None)
    quality.captured(2, captured_at(2), luma(2))
    fates = quality.shown(0, captured_at(2) + 1, None)
    fates += quality.shown(1, captured_at(2) + 2, luma(1001))
    fates += quality.shown(2, captured_at(2) + 3, luma(1002))
    scores = [Scorer().score(fate) for fate in fates]
    assert [one.shown_ns is None for one in scores] == [False] * 3
    assert [one.received is None for one in scores] == [True, True, False]
    assert fates[2].record.received is None

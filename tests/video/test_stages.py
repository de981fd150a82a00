"""What the stages of a frame's way take: the rule of the slowest, and the means of a session."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import LatencyState
from tams_app.units import NS_PER_MS
from tams_app.video.core.stages import (
    DISPLAY,
    STAGES,
    StageMeans,
    slowest_stage,
    stage_words,
    together,
)

pytestmark = pytest.mark.untimed

SENDER, RECEIVER = LatencyState(14, "encoder", 9), LatencyState(3, "decoder", 3)


@pytest.mark.parametrize(
    ("ms", "slowest"),
    [
        ({"encoder": 7.0, "network": 45.0, "decoder": 3.0}, "encoder"),
        ({"network": 45.0}, None),
        ({"camera": None, "decoder": 3.0}, "decoder"),
        (dict.fromkeys(STAGES), None),
    ],
)
def test_the_slowest_stage_is_one_beside_the_network_that_is_known(
    ms: dict[str, float | None], slowest: str | None
) -> None:
    assert slowest_stage(ms) == slowest


def test_each_stage_has_words_and_what_the_other_side_makes_up_is_not_shown() -> None:
    assert [stage_words(stage) for stage in STAGES] == list(STAGES.values())
    assert (stage_words(DISPLAY), stage_words("scaler")) == ("display", "another stage")


def test_without_a_frame_or_its_times_no_stage_is_known() -> None:
    means = StageMeans()
    means.step("camera", 0, 40 * NS_PER_MS)
    means.step("to_encoder", 40 * NS_PER_MS, 0)
    assert means.latency is None


@given(st.lists(st.integers(1, 200), min_size=1, max_size=80))
def test_a_mean_lies_between_the_least_and_the_most_and_follows_a_change(took: list[int]) -> None:
    means = StageMeans()
    for ms in took:
        means.step("encoder", NS_PER_MS, NS_PER_MS + ms * NS_PER_MS)
    latency = means.latency
    assert min(took) <= latency.slowest_ms <= max(took)
    for _ in range(150):
        means.step("encoder", NS_PER_MS, 8 * NS_PER_MS)
    assert means.latency == LatencyState(7, "encoder", 7)


def test_all_stages_are_added_up_and_the_longest_is_named() -> None:
    means = StageMeans()
    for stage, ms in (("to_encoder", 2), ("encoder", 9), ("sender", 1)):
        means.step(stage, NS_PER_MS, NS_PER_MS + ms * NS_PER_MS)
    assert means.latency == LatencyState(12, "encoder", 9)


def test_two_sides_together_have_the_stages_of_both_and_of_one_alone_nothing_is_told() -> None:
    assert together(SENDER, RECEIVER) == together(RECEIVER, SENDER)
    assert together(SENDER, RECEIVER) == LatencyState(17, "encoder", 9)
    assert together(SENDER, None) is together(None, RECEIVER) is None

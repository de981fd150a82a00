"""Gaps between samples, by the quantity that holds the arm; `doctor --link` and sessions alike."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import LinkConfig
from tams_app.link.gaps import MOST_A_MINUTE, GapWatch, advice, lost_after_for
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

LINK = LinkConfig()
BURSTS_MS = [150.0, 160.0, 158.0, 152.0, 149.0] + [20.0] * 200  # in five seconds, one a second


def test_gaps_that_would_hold_the_arm_are_counted_a_minute_and_prescribed_for() -> None:
    assert lost_after_for(BURSTS_MS, 5.0, LINK) == 200.0
    said = advice(BURSTS_MS, 5.0, LINK)
    assert said.startswith("the longest gaps are 160, 158, 152 ms; 60 a minute")
    assert "switch Wi-Fi power saving off" in said
    assert "set link.lost_after_ms to 200" in said


def test_where_few_gaps_hold_the_arm_nothing_is_prescribed() -> None:
    few = [300.0, 250.0, 120.0] + [8.0] * 100
    assert lost_after_for(few, 60.0, LINK) == 100.0
    assert "power saving" not in advice(few, 60.0, LINK)


def test_a_network_that_stands_still_for_long_again_and_again_has_no_setting() -> None:
    assert lost_after_for([900.0] * 5, 5.0, LINK) is None
    assert "no setting helps" in advice([900.0] * 5, 5.0, LINK)


def test_where_a_larger_limit_would_only_make_the_gaps_too_many_no_setting_helps() -> None:
    assert lost_after_for(BURSTS_MS, 5.0, LINK, 3) is None
    assert lost_after_for(BURSTS_MS, 5.0, LINK, 2) == 200.0, "which leaves a part of the holds"
    said = advice([1500.0] * 3 + BURSTS_MS, 5.0, LINK, 7)
    assert "; 84 a minute are the third within a second and hold the arm (link gaps): no" in said
    assert len(said) <= 220


@given(
    gaps_ms=st.lists(st.floats(1.0, 2000.0), min_size=1, max_size=60), seconds=st.floats(5.0, 300.0)
)
def test_what_is_prescribed_is_valid_and_holds_the_arm_three_times_a_minute_at_most(
    gaps_ms: list[float], seconds: float
) -> None:
    prescribed_ms = lost_after_for(gaps_ms, seconds, LINK)
    if prescribed_ms is None:
        return
    assert LinkConfig(lost_after_ms=prescribed_ms).lost_after_ms == prescribed_ms >= 100.0
    exceed = sum(gap_ms > prescribed_ms for gap_ms in gaps_ms)
    assert exceed * 60.0 / seconds <= MOST_A_MINUTE


def watched(gap_ms: float, every_s: float, armed: bool = True, too_often: int = 0) -> list[str]:
    """What two minutes of samples say, with such a gap so often, and so many that are too many."""
    watch, said, now_ns, last_ns = GapWatch(LINK), [], 0, 0
    while now_ns < 120 * NS_PER_S:
        is_due = now_ns - last_ns >= every_s * NS_PER_S
        now_ns += round((gap_ms if is_due else 8.0) * NS_PER_MS)
        last_ns = now_ns if is_due else last_ns
        said.append(watch.step(now_ns, armed, min(too_often, now_ns // NS_PER_S)))
    return [one for one in said if one]


def test_a_session_that_is_held_by_gaps_more_than_three_times_a_minute_says_once_what_to_set() -> (
    None
):
    (said,) = watched(150.0, 1.0)
    assert "4 a minute exceed link.lost_after_ms (100 ms)" in said
    assert "set link.lost_after_ms to 180" in said


@pytest.mark.parametrize(("gap_ms", "every_s", "too_often"), [(150.0, 0.3, 0), (80.0, 0.3, 60)])
def test_a_session_that_is_held_by_gaps_in_a_row_says_that_no_setting_helps(
    gap_ms: float, every_s: float, too_often: int
) -> None:
    (said,) = watched(gap_ms, every_s, too_often=too_often)
    assert "a minute are the third within a second and hold the arm (link gaps): no setting" in said


@pytest.mark.parametrize(
    ("gap_ms", "every_s", "armed"), [(150.0, 21.0, True), (99.0, 0.5, True), (150.0, 1.0, False)]
)
def test_a_session_that_is_held_seldom_or_not_at_all_says_nothing(
    gap_ms: float, every_s: float, armed: bool
) -> None:
    assert watched(gap_ms, every_s, armed) == []


def test_the_time_between_two_operators_is_no_gap() -> None:
    watch = GapWatch(LINK)
    for number in range(20):
        watch.forget()
        assert watch.step(number * NS_PER_S, armed=True, too_often=0) == ""

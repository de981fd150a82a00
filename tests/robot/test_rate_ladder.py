"""The ladder of frame rates: down soon, up slowly, and never to and fro."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.robot.rate_ladder import (
    LONGEST_WAIT_NS,
    RAISE_AFTER_NS,
    SETTLING,
    STARTING,
    SUSTAINED,
    Observation,
    RateLadder,
)
from tams_app.runtime.machine_speed import LADDER_FPS, rungs
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed

CALM = Observation(missed=0.0, late=0.0)
MISSING = Observation(missed=0.3, late=0.0)
LATE = Observation(missed=0.0, late=0.05)
BEHIND = Observation(missed=0.0, late=0.0, encoder_behind=True)
BETWEEN = Observation(missed=0.08, late=0.0)

shares = st.floats(0.0, 1.0)
observations = st.builds(Observation, shares, shares, st.booleans())
asked = st.integers(5, 60).map(float)


def climb(ladder: RateLadder, seen: list[Observation], begin_s: int = 0) -> list[float]:
    """The rate after each observation, one a second."""
    rates = []
    for number, one in enumerate(seen, begin_s):
        ladder.step(number * NS_PER_S, one)
        rates.append(ladder.fps)
    return rates


def machine(ladder: RateLadder, holds_fps: float, seconds: int) -> list[float]:
    """The rate in each second on a machine that misses every frame above `holds_fps`."""
    rates = []
    for second in range(seconds):
        missed = max(0.0, 1.0 - holds_fps / ladder.fps)
        ladder.step(second * NS_PER_S, Observation(missed, late=0.0))
        rates.append(ladder.fps)
    return rates


@given(asked)
def test_the_rungs_are_what_was_asked_for_and_the_usual_rates_below(fps: float) -> None:
    found = rungs(fps)
    assert found[0] == fps
    assert list(found[1:]) == [rung for rung in LADDER_FPS if rung < fps]


@given(asked, st.floats(1.0, 60.0))
def test_it_starts_at_the_highest_rung_that_is_not_above_the_start(
    fps: float, start: float
) -> None:
    ladder = RateLadder(fps, start)
    below = [rung for rung in rungs(fps) if rung <= start]
    assert ladder.fps == (below[0] if below else rungs(fps)[-1])


@given(asked, st.lists(observations, max_size=300))
def test_the_rate_is_always_a_rung(fps: float, seen: list[Observation]) -> None:
    assert set(climb(RateLadder(fps), seen)) <= set(rungs(fps))


@given(st.lists(observations, max_size=100), st.sampled_from([MISSING, LATE, BEHIND]))
def test_lasting_trouble_steps_down_within_three_seconds(
    before: list[Observation], trouble: Observation
) -> None:
    ladder = RateLadder(30.0)
    before = [CALM] * STARTING + before
    climb(ladder, before)
    fps = ladder.fps
    climb(ladder, [trouble] * (SETTLING + SUSTAINED), len(before))
    assert ladder.fps < fps or fps == LADDER_FPS[-1]


@given(asked, st.lists(observations, max_size=100))
def test_one_bad_second_changes_nothing(fps: float, before: list[Observation]) -> None:
    ladder = RateLadder(fps)
    climb(ladder, [*before, CALM])
    rate = ladder.fps
    climb(ladder, [MISSING, CALM], len(before) + 1)
    assert ladder.fps == rate


@given(st.lists(observations, max_size=400))
def test_two_steps_up_lie_at_least_five_seconds_apart(seen: list[Observation]) -> None:
    rates = climb(RateLadder(30.0, 5.0), seen)
    ups = [second for second, (a, b) in enumerate(pairwise(rates)) if b > a]
    assert all(b - a >= RAISE_AFTER_NS / NS_PER_S for a, b in pairwise(ups))


@given(st.lists(observations, max_size=200))
def test_after_any_past_a_calm_machine_is_back_at_the_top(before: list[Observation]) -> None:
    ladder = RateLadder(30.0)
    climb(ladder, before)
    longest_s = len(LADDER_FPS) * (LONGEST_WAIT_NS // NS_PER_S + 2)
    assert climb(ladder, [CALM] * longest_s, len(before))[-1] == 30.0


@given(st.floats(5.0, 29.0), st.sampled_from(rungs(30.0)))
def test_a_rate_that_does_not_hold_is_tried_ever_less(holds_fps: float, start: float) -> None:
    rates = machine(RateLadder(30.0, start), holds_fps, 1200)
    last = rates[600:]
    most = max(rung for rung in LADDER_FPS if rung <= holds_fps)
    assert last.count(most) > 0.9 * len(last) or min(last) >= most
    failed = sum(b > a and holds_fps < 0.9 * b for a, b in pairwise(last))
    assert failed <= len(last) * NS_PER_S // LONGEST_WAIT_NS + 1


@pytest.mark.parametrize("start", [30.0, 20.0])
def test_a_rate_that_failed_is_tried_again_after_twice_the_time_up_to_a_minute(
    start: float,
) -> None:
    rates = machine(RateLadder(30.0, start), 20.0, 400)
    steps = list(enumerate(pairwise(rates)))
    downs = [second for second, (a, b) in steps if b < a]
    ups = [second for second, (a, b) in steps if b > a]
    waits = [next(up for up in ups if up > down) - down for down in downs[:-1]]
    assert waits[:5] == pytest.approx([10, 20, 40, 60, 60], abs=SETTLING + 1)


def test_a_rate_that_held_for_half_a_minute_is_tried_again_as_if_it_had_never_failed() -> None:
    ladder = RateLadder(30.0)
    machine(ladder, 20.0, 200)
    steady = climb(ladder, [CALM] * 200, 200)
    assert steady[-1] == 30.0
    troubled = climb(ladder, [LATE, LATE, *[CALM] * 15], 400)
    assert 20.0 in troubled
    assert troubled[-1] == 30.0


@pytest.mark.parametrize(("holds_fps", "rung"), [(26.0, 20.0), (16.0, 15.0), (6.5, 5.0)])
def test_where_frames_are_missed_it_goes_straight_to_what_was_reached(
    holds_fps: float, rung: float
) -> None:
    ladder = RateLadder(30.0)
    assert machine(ladder, holds_fps, STARTING + SUSTAINED)[-1] == rung


@pytest.mark.parametrize("seen", [LATE, BEHIND])
def test_late_ticks_and_full_encoders_cost_one_rung_at_a_time(seen: Observation) -> None:
    assert climb(RateLadder(30.0), [CALM] * STARTING + [seen] * SUSTAINED)[-1] == 20.0


def test_between_calm_and_trouble_a_rate_is_kept() -> None:
    assert set(climb(RateLadder(30.0, 15.0), [BETWEEN] * 300)) == {15.0}


def test_the_better_of_the_troubled_seconds_says_what_was_reached() -> None:
    worse = Observation(missed=0.8, late=0.0)
    for seen in ([worse, MISSING], [MISSING, worse]):
        assert climb(RateLadder(30.0), [CALM] * STARTING + seen)[-1] == 20.0


def test_the_first_seconds_do_not_count() -> None:
    assert climb(RateLadder(30.0), [MISSING] * STARTING + [CALM]) == [30.0] * (STARTING + 1)


def test_what_was_seen_before_a_change_does_not_count_for_the_new_rate() -> None:
    ladder = RateLadder(30.0)
    climb(ladder, [CALM] * STARTING)
    assert climb(ladder, [LATE, LATE], STARTING) == [30.0, 20.0]
    assert climb(ladder, [LATE, LATE, CALM], STARTING + 2) == [20.0] * 3


@pytest.mark.parametrize(
    ("seen", "reason"),
    [
        (MISSING, "30 % of the frames were missed"),
        (LATE, "5 % of the control ticks were late"),
        (BEHIND, "frames waited for an encoder"),
    ],
)
def test_a_change_has_its_reason(seen: Observation, reason: str) -> None:
    ladder = RateLadder(30.0)
    climb(ladder, [CALM] * STARTING)
    assert [ladder.step(number * NS_PER_S, seen) for number in (4, 5)] == ["", reason]

"""A trigger that chatters: never a motion without the deadman, never a jump."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.records import ControllerSample
from tams_app.teleop.safety import ArmingState
from tests.faults.bench import ACROSS, PERIOD_S
from tests.faults.braking import TICKS_TO_REST, keeps_stop_profile
from tests.faults.hand import Distortion
from tests.faults.promises import reengages
from tests.faults.virtual_bench import VirtualBench

pytestmark = pytest.mark.untimed

_ROUNDING_M_S = 1e-4


@pytest.fixture
def bench() -> Iterator[VirtualBench]:
    made = VirtualBench()
    yield made
    made.close()


def chatter(values: list[float]) -> Distortion:
    """The trigger reads `values` again and again."""
    count = -1

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        nonlocal count
        count += 1
        return replace(true, trigger=values[count % len(values)])

    return distort


def moves_only_with_the_deadman(bench: VirtualBench, first: int) -> None:
    """Judges every tick from `first` on by its record and by the wire.

    Without the deadman the arm brakes from the speed it had; an acceleration that was under way
    dies out within the stop profile, which adds a²/2j.
    """
    velocities = bench.velocities(first - 2)
    keeps_stop_profile(bench, velocities)
    speeds = np.linalg.norm(velocities[:, :3], axis=1)
    limits = bench.config.limits
    dying_m_s = limits.motion.acceleration_m_s2**2 / (2 * limits.stop.jerk_m_s3)
    held_number = 1
    for number, tick in enumerate(bench.ticks[first:], start=2):
        if tick.deadman:
            held_number = number
            continue
        assert tick.arming != ArmingState.ENGAGED
        if number - held_number > TICKS_TO_REST:
            assert speeds[number] == 0.0
        else:
            assert speeds[number] <= speeds[held_number] + dying_m_s, "braking"


def test_within_its_hysteresis_the_trigger_stays_as_it_is(bench: VirtualBench) -> None:
    bench.engage_and_move(0.4 * ACROSS)
    first = bench.next
    bench.hand.distortion = chatter([0.59, 0.41, 0.5, 0.401])
    bench.run(0.5)
    assert {tick.arming for tick in bench.ticks[first:]} == {ArmingState.ENGAGED}
    moves_only_with_the_deadman(bench, first)
    assert np.linalg.norm(bench.velocities(bench.now)[0][:3]) > 0.09


def test_within_its_hysteresis_a_free_trigger_never_engages(bench: VirtualBench) -> None:
    bench.arm_it()
    first = bench.next
    bench.hand.velocity = ACROSS
    bench.hand.distortion = chatter([0.59, 0.0, 0.599, 0.41])
    bench.run(1.0)
    assert {tick.arming for tick in bench.ticks[first:]} == {ArmingState.READY}
    assert not bench.velocities(first).any()


@pytest.mark.parametrize("free", [1, 2, 5])
def test_a_trigger_that_flickers_brings_the_arm_to_rest_and_moves_it_no_more(
    bench: VirtualBench, free: int
) -> None:
    bench.engage_and_move()
    first = bench.next
    bench.hand.distortion = chatter([0.39] * free + [0.61])
    bench.run(0.6)
    moves_only_with_the_deadman(bench, first)
    rest = first + TICKS_TO_REST
    assert np.abs(bench.velocities(rest)).max() < _ROUNDING_M_S
    assert bench.travel_m(rest) < 1e-6
    assert {tick.arming for tick in bench.ticks[first:]} == {
        ArmingState.READY,
        ArmingState.ENGAGED,
    }
    bench.hand.distortion = None
    bench.hand.trigger = 0.0
    bench.hand.velocity = np.zeros(3)
    bench.run(0.3)
    reengages(bench)


@pytest.mark.parametrize("held", [2, 5, 20])
@pytest.mark.parametrize("free", [1, 5, 20])
def test_slower_chatter_moves_the_arm_no_further_than_the_hand_went_with_the_trigger_held(
    bench: VirtualBench, free: int, held: int
) -> None:
    bench.arm_it()
    bench.run(0.1)
    bench.hand.velocity = 0.4 * ACROSS
    first = bench.next
    bench.hand.distortion = chatter([0.39] * free + [0.61] * held)
    bench.run(0.8)
    moves_only_with_the_deadman(bench, first)
    held_ticks = sum(tick.deadman for tick in bench.ticks[first:])
    assert bench.travel_m(first) <= 0.4 * ACROSS[1] * held_ticks * PERIOD_S + 0.0001


@given(values=st.lists(st.floats(0.3, 0.7), min_size=2, max_size=40))
@settings(max_examples=15, deadline=None, derandomize=True)
def test_any_chatter_moves_the_arm_only_with_the_deadman_and_never_further_than_the_hand(
    values: list[float],
) -> None:
    bench = VirtualBench()
    bench.engage_and_move(0.4 * ACROSS, seconds=0.3)
    first, hand_m = bench.next, bench.hand.travelled_m
    bench.hand.distortion = chatter(values)
    bench.run(0.8)
    bench.hand.distortion = None
    bench.hand.trigger = 0.0
    bench.run(0.2)
    moves_only_with_the_deadman(bench, first)
    lag_m = 0.4 * ACROSS[1] * (TICKS_TO_REST + 8) * PERIOD_S  # what the arm was still behind
    assert bench.travel_m(first) <= bench.hand.travelled_m - hand_m + lag_m
    assert not bench.velocities(bench.now)[0].any()
    bench.close()

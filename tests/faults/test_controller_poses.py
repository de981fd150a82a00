"""Poses or buttons that stop, repeat, come late or jump: the arm never jumps and never goes on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS
from tests.faults import distortions
from tests.faults.bench import ACROSS, FULL_SPEED_M_S, PERIOD_S
from tests.faults.braking import TICKS_TO_REST, holds, keeps_stop_profile
from tests.faults.hand import Distortion
from tests.faults.promises import (
    is_logged,
    is_stopped,
    recovers_from_fault,
    recovers_from_hold,
    stands,
)
from tests.faults.virtual_bench import VirtualBench

pytestmark = pytest.mark.untimed

# Ticks from the first reading that shows the fault to the stop, at 120 Hz and the defaults.
FROZEN_TICKS = 12  # 100 ms without a change (freshness.pose_frozen_ms)
STALE_TICKS = 12  # 100 ms without a read of the buttons (freshness.buttons_ms)
REJECTED_TICKS = 6  # impossible poses in a row (`MAX_REJECTS`)
SLOWING_TICKS = 4  # 25 ms: an unchanged pose keeps its velocity no longer (freshness.hold_pose_ms)


@pytest.fixture
def bench(virtual_bench: VirtualBench) -> VirtualBench:
    return virtual_bench


def speeds(bench: VirtualBench, first: int) -> np.ndarray:
    """Commanded linear speeds [m/s] of the ticks from `first` on; 0 where nothing was sent."""
    return np.array(
        [0.0 if each is None else np.linalg.norm(each[:3]) for each in bench.commands(first)]
    )


def is_smooth(bench: VirtualBench, first: int) -> None:
    """Every tick from `first` on commanded a motion, within the limits of speed and profiles."""
    keeps_stop_profile(bench, bench.velocities(first))


@pytest.mark.parametrize("distortion", [distortions.frozen_pose, distortions.zero_pose])
def test_a_pose_that_stops_changing_slows_the_arm_at_once_and_is_a_fault_after_100_ms(
    bench: VirtualBench, distortion: Distortion
) -> None:
    bench.engage_and_move()
    frozen = bench.next
    bench.hand.distortion = distortion
    bench.run(0.5)
    first_unchanged = frozen + (distortion is distortions.zero_pose)  # its first one is a change
    is_stopped(bench, first_unchanged + FROZEN_TICKS, Reason.POSE_FROZEN)
    slowing = speeds(bench, frozen)[: first_unchanged - frozen + FROZEN_TICKS]
    assert slowing[SLOWING_TICKS + 2 :].max() < FULL_SPEED_M_S
    assert (np.diff(slowing) < 1e-3).all()
    stands(bench)
    bench.hand.distortion = None
    bench.hand.velocity = np.zeros(3)
    recovers_from_fault(bench)
    is_logged(bench, Reason.POSE_FROZEN)


def test_buttons_that_are_not_read_any_more_release_the_deadman_after_100_ms(
    bench: VirtualBench,
) -> None:
    bench.engage_and_move()
    stale = bench.next
    bench.hand.distortion = distortions.frozen_buttons
    bench.hand.trigger = 0.0  # which is not seen
    bench.run(0.5)  # the pose stays alive and goes on
    assert holds(bench, stale + STALE_TICKS, Reason.BUTTONS_STALE) <= TICKS_TO_REST
    stands(bench)
    bench.hand.distortion = None
    bench.hand.velocity = np.zeros(3)
    bench.hand.trigger = 1.0
    recovers_from_hold(bench, Reason.BUTTONS_STALE)
    is_logged(bench, Reason.BUTTONS_STALE)


@pytest.mark.parametrize(
    "make",
    [distortions.repeated, distortions.shuffled, lambda: distortions.delayed(40 * NS_PER_MS)],
    ids=["duplicate", "out of order", "40 ms late"],
)
def test_poses_that_come_twice_disordered_or_a_little_late_neither_stop_nor_shake_the_arm(
    bench: VirtualBench, make: Callable[[], Distortion]
) -> None:
    bench.engage_and_move(0.5 * ACROSS)
    before = bench.next
    bench.hand.distortion = make()
    bench.run(0.6)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    is_smooth(bench, before)
    settled = speeds(bench, before)[30:]
    assert np.abs(settled - 0.5 * FULL_SPEED_M_S).max() < 0.1 * FULL_SPEED_M_S
    bench.hand.trigger = 0.0
    released = bench.next
    bench.run(0.3)
    assert speeds(bench, released)[TICKS_TO_REST:].max() == 0.0


def test_poses_that_say_they_are_100_ms_old_are_a_fault_at_once(bench: VirtualBench) -> None:
    bench.engage_and_move()
    late = bench.next
    bench.hand.distortion = distortions.old(100 * NS_PER_MS)
    bench.run(0.3)
    is_stopped(bench, late, Reason.POSE_FROZEN)
    bench.hand.distortion = None
    bench.hand.velocity = np.zeros(3)
    recovers_from_fault(bench)


def test_poses_that_say_they_are_older_than_25_ms_move_nothing(bench: VirtualBench) -> None:
    bench.engage_and_move()
    late = bench.next
    bench.hand.distortion = distortions.old(40 * NS_PER_MS)
    bench.run(1.0)
    is_smooth(bench, late)
    assert bench.travel_m(bench.next - 30) < 0.001


@pytest.mark.parametrize("by_m", [0.05, 1.0], ids=["5 cm", "1 m"])
def test_a_hand_found_elsewhere_moves_the_arm_on_as_if_it_had_not_jumped(
    bench: VirtualBench, by_m: float
) -> None:
    bench.engage_and_move(0.5 * ACROSS)
    jump = bench.next
    bench.hand.distortion = distortions.jump_once(by_m)
    bench.run(0.3)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    is_smooth(bench, jump - 2)
    moved = bench.positions[-1] - bench.positions[jump - 1]
    expected = 0.5 * ACROSS * (bench.next - jump) * PERIOD_S
    assert np.linalg.norm(moved - expected) < 0.001


@pytest.mark.parametrize("by_m", [0.05, 1.0], ids=["5 cm", "1 m"])
def test_a_hand_that_jumps_about_is_a_fault_after_six_readings_and_never_moves_the_arm(
    bench: VirtualBench, by_m: float
) -> None:
    bench.engage_and_move()
    jumps = bench.next
    bench.hand.distortion = distortions.jump_about(by_m)
    bench.run(0.5)
    is_stopped(bench, jumps + REJECTED_TICKS, Reason.HAND_TOO_FAST)
    moving = speeds(bench, jumps)[:REJECTED_TICKS]
    assert moving.max() <= FULL_SPEED_M_S * (1 + 1e-5)
    assert bench.travel_m(jumps) < FULL_SPEED_M_S * (REJECTED_TICKS + TICKS_TO_REST) * PERIOD_S
    stands(bench)
    bench.hand.distortion = None
    bench.hand.velocity = np.zeros(3)
    recovers_from_fault(bench)
    is_logged(bench, Reason.HAND_TOO_FAST)


@pytest.mark.parametrize(("by_m", "ticks"), [(0.05, 2), (0.05, 4), (0.05, 8), (1.0, 35)], ids=str)
def test_a_jump_slow_enough_for_a_hand_is_followed_within_all_limits(
    bench: VirtualBench, by_m: float, ticks: int
) -> None:
    bench.arm_it()
    bench.engage()
    bench.run(0.1)
    jump = bench.next
    bench.hand.distortion = distortions.jump_slowly(by_m, ticks)
    bench.run(0.8)
    is_smooth(bench, jump - 2)
    profile = bench.config.limits.motion
    velocities = bench.velocities(jump - 2)[:, :3]
    accelerations = np.linalg.norm(np.diff(velocities, axis=0), axis=1) / PERIOD_S
    if bench.outputs[-1].arming is ArmingState.ENGAGED:
        assert accelerations.max() <= profile.acceleration_m_s2 * 1.01
        assert speeds(bench, bench.next - 1)[0] < 0.005
    assert bench.travel_m(jump) <= by_m + 0.001

"""Frames that stop coming, in virtual time: the primary view's age slows and holds the arm."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tams_app.records import Phase
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS
from tests.faults.bench import ACROSS, DOWN, FULL_SPEED_M_S, PERIOD_NS
from tests.faults.braking import TICKS_TO_REST, holds
from tests.faults.frames import PICTURE_DELAY_NS
from tests.faults.promises import is_logged, recovers_from_hold, stands
from tests.faults.virtual_bench import VirtualBench

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
# On s2: three times (40 ms one way + 132 ms in the jitter buffer), then video_hold_ms.
SLOW_NS = 516 * NS_PER_MS
HOLD_NS = 1000 * NS_PER_MS
# Ticks from the first one of a frame that stands still to the hold.
HOLD_TICKS = math.ceil((HOLD_NS - PICTURE_DELAY_NS) / PERIOD_NS) - 1
PRIMARY = {Phase.REACH: "gt", Phase.ALIGN: "eih", Phase.TRANSPORT: "gs"}


@pytest.fixture
def bench(virtual_bench: VirtualBench) -> VirtualBench:
    return virtual_bench


def move_in(bench: VirtualBench, phase: Phase) -> None:
    """Bring the arm into a steady motion in `phase`."""
    bench.engage_and_move(0.1 * ACROSS, seconds=0.2)
    if phase is Phase.TRANSPORT:
        bench.hand.a = True
        bench.run(0.3)
        bench.hand.velocity = -0.1 * ACROSS
    if phase is Phase.ALIGN:
        bench.hand.velocity = DOWN
    bench.run(0.6)
    assert bench.ticks[-1].phase is phase
    assert bench.outputs[-1].arming is ArmingState.ENGAGED


def expected_scale(age_ns: int) -> float:
    """All of the speed up to SLOW_NS, nothing from HOLD_NS on, a straight line between."""
    return min(1.0, max(0.0, (HOLD_NS - age_ns) / (HOLD_NS - SLOW_NS)))


def slows_holds_and_recovers(bench: VirtualBench, frozen: int) -> None:
    """As the view that counts, which has stood still since tick `frozen`, grows old."""
    for after, output in enumerate(bench.outputs[frozen : frozen + HOLD_TICKS], start=1):
        assert output.arming is ArmingState.ENGAGED
        scale = expected_scale(PICTURE_DELAY_NS + after * PERIOD_NS)
        assert output.speed_scale == pytest.approx(scale, abs=1e-9)
    assert holds(bench, frozen + HOLD_TICKS, Reason.STALE_VIDEO) <= TICKS_TO_REST
    stands(bench)
    bench.hand.velocity = np.zeros(3)
    bench.frames.thaw()
    recovers_from_hold(bench, Reason.STALE_VIDEO)
    is_logged(bench, Reason.STALE_VIDEO)


@pytest.mark.parametrize("phase", PRIMARY, ids=str)
@pytest.mark.parametrize("view", [*VIEWS, "all"])
def test_a_frozen_view_holds_the_arm_exactly_if_it_is_the_primary_one(
    bench: VirtualBench, view: str, phase: Phase
) -> None:
    move_in(bench, phase)
    frozen = bench.next
    bench.frames.freeze(*(VIEWS if view == "all" else (view,)))
    bench.run(1.3)
    if view not in (PRIMARY[phase], "all"):
        assert {output.arming for output in bench.outputs[frozen:]} == {ArmingState.ENGAGED}
        assert {output.speed_scale for output in bench.outputs[frozen:]} == {1.0}
        assert bench.travel_m(bench.next - 30) > 0.001
        return
    slows_holds_and_recovers(bench, frozen)


def test_the_older_the_frame_the_slower_the_arm(bench: VirtualBench) -> None:
    bench.engage_and_move()
    bench.frames.freeze(PRIMARY[Phase.REACH])
    frozen = bench.next
    bench.run(0.9)
    lag = 20  # ticks in which the commanded speed follows the scale, at the motion profile
    speeds = np.linalg.norm(bench.velocities(frozen)[:, :3], axis=1)
    for after, speed in enumerate(speeds):
        age_ns = PICTURE_DELAY_NS + (after + 1 - lag) * PERIOD_NS
        assert speed <= FULL_SPEED_M_S * (expected_scale(age_ns) + 1e-3)
    assert speeds[-1] < 0.2 * FULL_SPEED_M_S


def test_a_phase_that_begins_on_a_frozen_view_holds_the_arm_in_the_next_tick(
    bench: VirtualBench,
) -> None:
    move_in(bench, Phase.REACH)
    bench.frames.freeze("eih")
    bench.run(1.2)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    bench.hand.a = True  # closes the gripper: the phase is GRASP, its primary view eih
    changed = next(
        bench.now for _ in range(30) if bench.tick() and bench.ticks[-1].phase is Phase.GRASP
    )
    bench.run(0.5)
    assert holds(bench, changed + 1, Reason.STALE_VIDEO) <= TICKS_TO_REST
    bench.hand.a = False
    bench.hand.velocity = np.zeros(3)
    bench.frames.thaw()
    recovers_from_hold(bench, Reason.STALE_VIDEO)


@pytest.mark.parametrize(("seconds", "held"), [(0.3, False), (1.0, True), (5.0, True)])
def test_a_blackout_holds_the_arm_if_the_frame_grows_a_second_old(
    bench: VirtualBench, seconds: float, held: bool
) -> None:
    bench.engage_and_move(0.1 * ACROSS, seconds=0.2)
    dark = bench.next
    bench.frames.freeze(*VIEWS)
    bench.run(seconds)
    bench.frames.thaw()
    back = bench.next
    bench.run(0.3)
    if not held:
        assert {output.arming for output in bench.outputs[dark:]} == {ArmingState.ENGAGED}
        assert {output.speed_scale for output in bench.outputs[dark:]} == {1.0}
        return
    holds(bench, dark + HOLD_TICKS, Reason.STALE_VIDEO)
    assert back > dark + HOLD_TICKS
    bench.hand.velocity = np.zeros(3)
    recovers_from_hold(bench, Reason.STALE_VIDEO)


def test_nothing_engages_before_the_first_frame(bench: VirtualBench) -> None:
    bench.arm_it()
    bench.frames.freeze(*VIEWS)
    bench.run(1.1)
    bench.hand.trigger = 1.0
    bench.hand.velocity = ACROSS
    first = bench.next
    bench.run(0.5)
    assert bench.outputs[-1].arming is ArmingState.READY
    assert bench.outputs[-1].reason is Reason.STALE_VIDEO
    assert not bench.velocities(first).any()
    bench.frames.thaw()
    bench.run(0.5)
    assert bench.outputs[-1].arming is ArmingState.READY, "a trigger that was held engages nothing"


@pytest.mark.parametrize("phase", PRIMARY, ids=str)
@pytest.mark.parametrize("pinned", VIEWS)
def test_a_frozen_view_that_is_pinned_slows_and_holds_the_arm_in_any_phase_as_the_primary_one(
    bench: VirtualBench, pinned: str, phase: Phase
) -> None:
    move_in(bench, phase)
    bench.signals.pinned = pinned
    bench.run(0.1)
    frozen = bench.next
    bench.frames.freeze(pinned)
    bench.run(1.3)
    slows_holds_and_recovers(bench, frozen)


def test_pinning_a_view_that_is_minutes_old_holds_a_moving_arm_in_the_next_tick(
    bench: VirtualBench,
) -> None:
    move_in(bench, Phase.REACH)
    bench.frames.freeze("eih")
    bench.run(2.0)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    bench.signals.pinned = "eih"
    pinned = bench.next
    bench.run(0.5)
    assert holds(bench, pinned, Reason.STALE_VIDEO) <= TICKS_TO_REST


def test_no_pin_and_no_end_of_one_moves_an_arm_that_old_video_holds(bench: VirtualBench) -> None:
    move_in(bench, Phase.REACH)
    bench.frames.freeze("gt")
    bench.run(1.3)
    assert bench.outputs[-1].arming is ArmingState.HOLDING
    for pinned in ("eih", "", "gs"):
        bench.signals.pinned = pinned
        first = bench.next
        bench.run(0.5)
        assert bench.outputs[-1].arming is ArmingState.HOLDING
        assert not bench.velocities(first).any()
    bench.hand.velocity = np.zeros(3)
    recovers_from_hold(bench, Reason.STALE_VIDEO)  # by gs, which is fresh


def test_a_name_that_is_no_view_pins_nothing(bench: VirtualBench) -> None:
    move_in(bench, Phase.REACH)
    bench.signals.pinned = "none of them"
    frozen = bench.next
    bench.frames.freeze("gt")
    bench.run(1.3)
    assert holds(bench, frozen + HOLD_TICKS, Reason.STALE_VIDEO) <= TICKS_TO_REST

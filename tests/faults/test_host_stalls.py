"""The control loop held up, in virtual time: what the arm does meanwhile, and what comes after."""

from __future__ import annotations

import numpy as np
import pytest

from hw.guard.link import GuardMessage, Heartbeat
from hw.guard.process import GuardWatch, HeartbeatWatch
from hw.lite6.protocol import Register, State
from hw.sim.controller.joint_servo import CYCLE_NS, VELOCITY_ACCELERATION_M_S2
from tams_app.runtime.clock import FixedRate, VirtualClock
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faults.bench import ACROSS, FULL_SPEED_M_S, PERIOD_NS, PERIOD_S
from tests.faults.promises import is_logged, recovers_from_fault, recovers_from_hold, stands
from tests.faults.virtual_bench import VirtualBench

pytestmark = pytest.mark.untimed

GUARD_POLL_NS = 10 * NS_PER_MS  # twice hw.guard.process.POLL_S: to hear, and to see


@pytest.fixture
def bench(virtual_bench: VirtualBench) -> VirtualBench:
    return virtual_bench


def most_travel_m(bench: VirtualBench) -> float:
    """How far an arm at full speed goes on without a new command: its deadman, then its brake."""
    held_s = bench.config.arm.velocity_deadman_s
    return FULL_SPEED_M_S * (held_s + PERIOD_S) + FULL_SPEED_M_S**2 / VELOCITY_ACCELERATION_M_S2


def test_after_50_ms_the_arm_goes_on_without_a_jump(bench: VirtualBench) -> None:
    bench.engage_and_move()
    late = bench.next
    bench.tick(PERIOD_NS + 50 * NS_PER_MS)
    bench.run(0.2)
    assert {output.arming for output in bench.outputs[late:]} == {ArmingState.ENGAGED}
    before, first = bench.velocities(late - 1, late + 1)[:, :3]
    allowed_m_s = bench.config.limits.motion.acceleration_m_s2 * (PERIOD_S + 0.05)
    assert np.linalg.norm(first - before) <= allowed_m_s * 1.01
    steps = np.diff(bench.positions[late - 1 : late + 1], axis=0)
    # whole cycles of the controller fall between two ticks, one more or one less
    assert np.linalg.norm(steps) <= FULL_SPEED_M_S * (PERIOD_S + 0.05 + CYCLE_NS / NS_PER_S)
    speeds = np.linalg.norm(bench.velocities(late)[:, :3], axis=1)
    assert max(speeds) <= FULL_SPEED_M_S * (1 + 1e-4)


@pytest.mark.parametrize("stall_ms", [200, 1000])
def test_after_a_longer_stall_the_arm_stands_and_the_first_command_is_zero(
    bench: VirtualBench, stall_ms: int
) -> None:
    bench.engage_and_move()
    late = bench.next
    bench.tick(PERIOD_NS + stall_ms * NS_PER_MS)
    bench.run(0.3)
    assert bench.outputs[late].arming is ArmingState.HOLDING
    assert bench.outputs[late].reason is Reason.CONTROL_STALLED
    assert not bench.velocities(late).any(), "the arm has stopped by itself"
    assert bench.travel_m(late, late + 1) <= most_travel_m(bench)
    assert bench.travel_m(late + 1) < 1e-6
    stands(bench)
    bench.hand.velocity = np.zeros(3)
    recovers_from_hold(bench, bench.outputs[-1].reason or Reason.CONTROL_STALLED)
    is_logged(bench, Reason.CONTROL_STALLED)


@pytest.mark.parametrize("stall_ms", [200, 1000])
def test_the_guard_stops_the_arm_while_the_loop_is_held_up_and_the_loop_finds_it_so(
    bench: VirtualBench, stall_ms: int
) -> None:
    """The guard's own decision in virtual time; its process is in test_host_processes."""
    bench.engage_and_move()
    watch = HeartbeatWatch(round(bench.config.arm.guard.heartbeat_timeout_ms * NS_PER_MS))
    watch.hear(bench.beats[-1], Heartbeat(GuardMessage.BEAT, 1, 1))
    began_ns = bench.clock.now_ns()
    stopped_ns = None
    while bench.clock.now_ns() - began_ns < stall_ms * NS_PER_MS:
        bench.advance(GUARD_POLL_NS)
        if watch.lost(bench.clock.now_ns()):
            stopped_ns = bench.clock.now_ns()
            bench.model.handle(Register.SET_STATE, bytes([State.STOPPED]), stopped_ns)
    assert watch.watch is GuardWatch.LATCHED
    assert stopped_ns is not None
    assert stopped_ns - began_ns <= 110 * NS_PER_MS
    late = bench.next
    bench.signals.trip(Reason.GUARD_STOPPED)  # as the guard's link tells it
    bench.run(0.3)
    assert bench.outputs[late].arming is ArmingState.FAULT
    assert bench.outputs[late].reason is Reason.GUARD_STOPPED
    assert not any(request.is_motion for request in bench.model.since(late))
    stands(bench)
    bench.hand.velocity = np.zeros(3)
    recovers_from_fault(bench)
    is_logged(bench, Reason.GUARD_STOPPED)


def test_a_loop_that_waits_does_nothing_at_all_after_a_stall(bench: VirtualBench) -> None:
    bench.arm_it()
    bench.run(0.1)
    bench.tick(PERIOD_NS + NS_PER_S)
    bench.run(0.1)
    assert bench.outputs[-1].arming is ArmingState.READY
    bench.engage()
    bench.hand.velocity = 0.4 * ACROSS
    bench.run(0.3)
    assert bench.travel_m(bench.next - 30) > 0.005


def test_a_stream_of_short_stalls_neither_shakes_nor_stops_the_arm(bench: VirtualBench) -> None:
    bench.engage_and_move(0.4 * ACROSS)
    first = bench.next
    for number in range(40):
        bench.tick(PERIOD_NS + (number % 4) * 10 * NS_PER_MS)
    assert {output.arming for output in bench.outputs[first:]} == {ArmingState.ENGAGED}
    commands = bench.velocities(first - 1)[:, :3]
    intervals_s = np.diff([tick.started_ns for tick in bench.ticks[first - 1 :]]) / NS_PER_S
    changes = np.linalg.norm(np.diff(commands, axis=0), axis=1)
    allowed = bench.config.limits.motion.acceleration_m_s2 * intervals_s * 1.01 + 1e-5
    assert (changes <= allowed).all()
    assert np.linalg.norm(commands, axis=1).max() <= FULL_SPEED_M_S


def test_periods_that_were_missed_are_left_out_and_not_caught_up() -> None:
    clock = VirtualClock()
    rate = FixedRate(clock, 120.0)
    rate.wait()
    clock.advance_ns(NS_PER_S)
    started_ns = clock.now_ns()
    due_ns = rate.wait()
    assert rate.skipped == 119
    assert due_ns <= started_ns < due_ns + rate.period_ns
    assert rate.wait() > started_ns


def test_a_stall_at_the_very_limit_counts_as_the_deadman_does(bench: VirtualBench) -> None:
    """Up to `velocity_deadman_s` the arm still obeys the last command, beyond it has stopped."""
    bench.engage_and_move()
    bench.tick(100 * NS_PER_MS)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    late = bench.next
    bench.tick(101 * NS_PER_MS)
    bench.run(0.3)
    assert bench.outputs[late].arming is ArmingState.HOLDING
    assert bench.outputs[late].reason is Reason.CONTROL_STALLED
    assert not bench.velocities(late).any()

"""The way to the arm fails: no replies, slow ones, a broken connection, a silent report stream."""

from __future__ import annotations

import numpy as np
import pytest

from hw.lite6.protocol import Register
from hw.lite6.sender import MISSES_UNTIL_FAILURE
from tams_app.config import ArmConfig
from tams_app.records import Tick
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import PERIOD_S, Bench
from tests.faults.promises import (
    is_logged,
    is_stopped,
    only_stops,
    recovers_from_fault,
    recovers_from_hold,
    stands,
)
from tests.faults.wired_bench import REPLY_TIMEOUT_S, SIDEWAYS, MakeBench, WiredBench

# A third of the time in which a reply must come here.
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

STALE_TICKS = 13  # 100 ms, and the tick that sees it
SILENT_TICKS = 121  # 1 s, and the tick that sees it
TICKS_TO_REST = 12  # of the stop profile, from full speed


def lost(tick: Tick) -> bool:
    return tick.link.failure != ""


def until_lost(bench: WiredBench) -> int:
    """The tick that will be the first to see that the link has failed."""
    bench.until(lambda: bench.arm.link().failure != "")
    seen = bench.next
    bench.run_ticks(1)
    assert lost(bench.ticks[seen])
    return seen


def holds_first(bench: Bench, since: int, reason: Reason) -> int:
    """The tick, `since` or later, in which an engaged arm begins to hold, for `reason`."""
    held = bench.run_until_state(ArmingState.HOLDING)
    assert all(output.arming is ArmingState.ENGAGED for output in bench.outputs[since:held])
    assert bench.outputs[held].reason is reason
    return held


def brakes(bench: Bench, held: int) -> None:
    """From tick `held` on the loop asks for the stop profile and then for exactly zero."""
    speeds = [float(np.linalg.norm(tick.twist.linear)) for tick in bench.ticks[held:]]
    assert speeds == sorted(speeds, reverse=True)
    assert not any(speeds[TICKS_TO_REST:])


def answer_again(bench: WiredBench) -> None:
    bench.server.is_mute = lambda frame: False
    bench.server.reply_delay_s = 0.0
    bench.in_step = True


# --- replies ------------------------------------------------------------------------------------


def test_without_replies_the_arm_holds_and_then_is_stopped_until_it_answers(
    make_bench: MakeBench,
) -> None:
    bench = make_bench()
    bench.engage_and_move(SIDEWAYS / 4)
    bench.quiesce()
    bench.in_step = False
    bench.server.is_mute = lambda frame: True
    since = bench.next
    held = holds_first(bench, since, Reason.ARM_REPLY_LATE)
    assert held - since <= STALE_TICKS
    seen = bench.run_until_state(ArmingState.FAULT)
    assert seen == bench.first_seen(lost, since)
    bench.run_until(lambda output: len(only_stops(bench, seen)) >= 3)  # none is acknowledged
    is_stopped(bench, seen, Reason.ARM_LINK_LOST, "does not answer")
    brakes(bench, held)
    recovers_from_fault(bench, lambda: answer_again(bench))


def test_replies_later_than_a_period_are_counted_and_the_arm_goes_on(
    wired_bench: WiredBench,
) -> None:
    wired_bench.engage_and_move()
    slow = wired_bench.ticks[-1].link.slow
    wired_bench.in_step = False
    wired_bench.server.reply_delay_s = 0.025
    wired_bench.run_ticks(20)
    wired_bench.server.reply_delay_s = 0.0
    assert wired_bench.ticks[-1].link.slow > slow
    assert {output.arming for output in wired_bench.outputs[-20:]} == {ArmingState.ENGAGED}
    assert wired_bench.travel_m(wired_bench.next - 10) > 0.004, "it still moves"


def test_replies_later_than_the_arm_may_be_blind_hold_it_until_the_trigger_was_released(
    make_bench: MakeBench,
) -> None:
    bench = make_bench()
    bench.engage_and_move()
    bench.quiesce()
    bench.in_step = False
    bench.server.reply_delay_s = 0.2
    held = holds_first(bench, bench.next, Reason.ARM_REPLY_LATE)
    bench.run_ticks(2 * TICKS_TO_REST)
    brakes(bench, held)
    answer_again(bench)
    bench.run_until(lambda output: bench.ticks[-1].link.round_trip_ns < 50_000_000)
    recovers_from_hold(bench, Reason.ARM_REPLY_LATE)


def test_replies_later_than_the_time_out_are_a_fault(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.engage_and_move()
    bench.quiesce()
    bench.in_step = False
    bench.server.reply_delay_s = 2.5 * REPLY_TIMEOUT_S
    since = bench.next
    seen = bench.run_until_state(ArmingState.FAULT)
    assert seen == bench.first_seen(lost, since)
    is_stopped(bench, seen, Reason.ARM_LINK_LOST, "does not answer")
    recovers_from_fault(bench, lambda: answer_again(bench))


def test_an_arm_that_answers_no_more_is_stopped_within_100_ms() -> None:
    """By default: the next command, its time-out, that of the one behind it, the tick that sees."""
    arm = ArmConfig()
    assert PERIOD_S + MISSES_UNTIL_FAILURE * arm.reply_timeout_s + PERIOD_S < 0.1


# --- connections --------------------------------------------------------------------------------


def test_a_reset_connection_stops_the_arm_over_a_new_one(wired_bench: WiredBench) -> None:
    wired_bench.engage_and_move()
    wired_bench.quiesce()
    wired_bench.server.drop_connections()
    seen = until_lost(wired_bench)
    wired_bench.run_ticks(5)
    only_stops(wired_bench, seen)
    stands(wired_bench)
    assert {output.reason for output in wired_bench.outputs[seen:]} == {Reason.ARM_LINK_LOST}
    recovers_from_fault(wired_bench)
    is_logged(wired_bench, Reason.ARM_LINK_LOST)


def test_a_command_connection_that_breaks_alone_stops_the_arm(wired_bench: WiredBench) -> None:
    wired_bench.engage_and_move()
    wired_bench.quiesce()
    motion = Register.SET_CARTESIAN_VELOCITY
    wired_bench.server.is_cut = lambda frame: frame.register == motion
    wired_bench.run_ticks(1)
    seen = until_lost(wired_bench)
    wired_bench.server.is_cut = lambda frame: False
    is_stopped(wired_bench, seen, Reason.ARM_LINK_LOST, "connection to the arm is lost")
    recovers_from_fault(wired_bench)


@pytest.mark.parametrize("ticks_away", [20, SILENT_TICKS + 20])
def test_a_controller_that_restarts_is_stopped_when_it_is_back_and_set_up_anew(
    wired_bench: WiredBench, ticks_away: int
) -> None:
    wired_bench.engage_and_move()
    wired_bench.quiesce()
    settings = wired_bench.model.settings
    offset, sensitivity = settings.tcp_offset, settings.collision_sensitivity
    wired_bench.reachable = False
    wired_bench.server.refuse_connections = True
    wired_bench.server.drop_connections()
    seen = until_lost(wired_bench)
    with wired_bench.lock:
        wired_bench.model.power_cycle()
    wired_bench.run_ticks(ticks_away)
    assert wired_bench.requests(seen) == []
    wired_bench.server.refuse_connections = False
    wired_bench.run_until(lambda output: bool(wired_bench.requests(seen)))
    assert all(request.is_stop for request in wired_bench.requests(seen))
    stands(wired_bench)
    assert {output.reason for output in wired_bench.outputs[seen:]} == {Reason.ARM_LINK_LOST}
    wired_bench.reachable = True
    recovers_from_fault(wired_bench)
    assert wired_bench.model.settings.tcp_offset == pytest.approx(offset)
    assert wired_bench.model.settings.collision_sensitivity == sensitivity


# --- reports ------------------------------------------------------------------------------------


def test_frozen_reports_hold_the_arm_although_commands_succeed(bench: Bench) -> None:
    bench.engage_and_move()
    bench.model.reports_frozen = True
    since = bench.next
    held = holds_first(bench, since, Reason.ARM_STATE_STALE)
    assert held - since <= STALE_TICKS
    bench.run_ticks(2 * TICKS_TO_REST)
    brakes(bench, held)
    assert bench.requests(held)[-1].is_motion, "it holds, and goes on commanding zero"
    bench.model.reports_frozen = False
    recovers_from_hold(bench, Reason.ARM_STATE_STALE)


def test_reports_that_stay_frozen_are_a_fault(bench: Bench) -> None:
    bench.engage_and_move(SIDEWAYS / 2)
    bench.model.reports_frozen = True
    since = bench.next
    seen = bench.run_until_state(ArmingState.FAULT)
    assert seen - since <= SILENT_TICKS
    assert bench.outputs[seen].reason is Reason.ARM_SILENT
    bench.run_ticks(5)
    assert len(only_stops(bench, seen)) >= 5, "repeated until a report tells of it"
    bench.model.reports_frozen = False
    is_stopped(bench, seen, Reason.ARM_SILENT)
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_SILENT, stopped_for=Reason.ARM_STATE_STALE)

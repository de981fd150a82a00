"""What every fault must come to, judged by the wire, the records and the arm itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tams_app.records import Activity, Tick
from tams_app.robot.control import describe
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import Bench
from tests.faults.wire import Request

STILL_M = 0.001  # the most an arm moves after it was engaged anew, before the hand moves
STANDS_M = 1e-9
HAND_M_S = 0.1
UNDER_WAY_S = 0.15  # after which the arm follows the hand at its speed


def is_stopped(bench: Bench, seen: int, reason: Reason, detail: str = "") -> None:
    """In tick `seen` itself state 4 goes out, over its own connection, and nothing moves after.

    Ends with the arm at rest and reported so; the stops have ceased then.
    """
    bench.run_until(lambda output: not output.stop)
    bench.run_ticks(3)
    assert bench.outputs[seen - 1].arming is not ArmingState.FAULT
    for output, tick in zip(bench.outputs[seen:], bench.ticks[seen:], strict=True):
        assert output.arming is ArmingState.FAULT
        assert output.reason is reason
        assert tick.reason == describe(output)
        assert tick.twist.is_zero
    assert detail in bench.outputs[seen].detail
    only_stops(bench, seen)
    stands(bench)
    state = bench.arm.state()
    assert state is not None
    assert state.activity is Activity.STOPPED


def only_stops(bench: Bench, seen: int) -> list[Request]:
    """From tick `seen` on only state 4 is commanded, first in that very tick; these requests."""
    requests = bench.requests(seen)
    stops = [request for request in requests if request.is_stop]
    others = [request for request in requests if not request.is_stop]
    assert stops[0].tick == seen, "sent in the tick in which the fault is seen"
    assert len(others) <= bench.in_flight
    assert all(request.is_motion and request.tick == seen for request in others)
    if bench.in_flight:  # there are connections
        assert {stop.connection for stop in stops}.isdisjoint(moving_connections(bench))
    return stops


def moving_connections(bench: Bench) -> set[int]:
    """The connections over which motion was ever commanded."""
    return {request.connection for request in bench.requests(0) if request.is_motion}


def stands(bench: Bench, ticks: int | None = None) -> None:
    """The arm does not move at all while the control loop goes on for `ticks`."""
    first = bench.next
    bench.run_ticks(bench.pace.standing_ticks if ticks is None else ticks)
    assert bench.travel_m(first) < STANDS_M


def recovers_from_hold(bench: Bench, reason: Reason) -> None:
    """As the sentence says: the cause gone, release the trigger; then everything works again."""
    assert "{release}" in reason.lasting
    bench.run(0.3)
    assert bench.outputs[-1].arming is ArmingState.HOLDING, "held until the trigger is released"
    stands(bench)
    bench.hand.trigger = 0.0
    bench.run_until_state(ArmingState.READY)
    reengages(bench)


def recovers_from_fault(bench: Bench, cause_gone: Callable[[], object] = lambda: None) -> None:
    """As the sentence says: the cause gone, release the trigger, confirm; then arm it anew."""
    reason = bench.outputs[-1].reason
    assert reason is not None
    assert "confirm" in reason.lasting
    cause_gone()
    bench.signals.confirm(bench.clock.now_ns())
    bench.run_ticks(3)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not while the trigger is held"
    bench.hand.trigger = 0.0
    bench.run_ticks(3)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not before a confirmation"
    bench.signals.confirm(bench.clock.now_ns())
    bench.run_until_state(ArmingState.DISARMED)
    stands(bench)
    bench.arm_it()
    reengages(bench)


def reengages(bench: Bench) -> None:
    """The hand is elsewhere by now; pressing moves nothing, and then the arm follows the hand."""
    bench.hand.velocity = np.zeros(3)
    bench.run_ticks(2)
    first = bench.next
    bench.engage()
    bench.run(bench.pace.rest_s)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED, bench.ticks[-1].reason
    assert bench.travel_m(first) < STILL_M
    start, move_s = bench.positions[-1], bench.pace.move_s
    bench.hand.velocity = np.array([0.0, -HAND_M_S, 0.0])
    bench.run(move_s)
    moved = bench.positions[-1] - start
    assert bench.outputs[-1].arming is ArmingState.ENGAGED, bench.ticks[-1].reason
    assert moved[1] < -HAND_M_S * (move_s - UNDER_WAY_S)
    assert abs(moved[0]) + abs(moved[2]) < 0.001


def is_logged(bench: Bench, reason: Reason, stopped_for: Reason | None = None) -> None:
    """The log, written by the recorder and read back, tells the same story tick by tick.

    `stopped_for`: the hold that had stopped the arm before, if there was one.
    """
    log = bench.read_back()
    assert not log.truncated
    assert [_story(tick) for tick in log.ticks] == [_story(tick) for tick in bench.ticks]
    assert reason.label in {_label(tick) for tick in log.ticks}
    stopping = (stopped_for or reason).label
    stop = next(stop for stop in log.stops if stop.reason == stopping)
    first = next(tick for tick in log.ticks if _stops_the_arm(tick) and _label(tick) == stopping)
    assert stop.visible_ns == first.started_ns
    assert stop.stopped_ns is not None
    assert stop.stopped_ns > stop.visible_ns


def _story(tick: Tick) -> tuple[object, ...]:
    twist = (*tick.twist.linear, *tick.twist.angular)
    return tick.started_ns, tick.arming, tick.reason, tick.deadman, tick.speed_scale, twist


def _label(tick: Tick) -> str:
    return tick.reason.split(":")[0]


def _stops_the_arm(tick: Tick) -> bool:
    return tick.arming in (ArmingState.HOLDING, ArmingState.FAULT)

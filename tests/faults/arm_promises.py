"""What every fault of the arm must come to, judged by the wire, the records and the arm itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tams_app.session.control import describe
from tams_app.teleop.safety import ArmingState, Reason

from .arm_bench import SIDEWAYS, ArmBench, LiveBench
from .wire import Request

STILL_M = 0.001  # the most an arm moves after it was engaged anew, before the hand moves
STANDS_M = 1e-6
ONE_IN_FLIGHT = 1  # motion command that was handed over a tick before and may come late


def is_stopped(bench: ArmBench, seen: int, reason: Reason, detail: str = "") -> None:
    """In tick `seen` itself state 4 goes out, over its own connection, and nothing moves after.

    Ends with the arm at rest and reported so; the stops have ceased then.
    """
    bench.run_until(lambda output: not output.stop)
    bench.run(3)
    assert bench.outputs[seen - 1].arming is not ArmingState.FAULT
    for output, tick in zip(bench.outputs[seen:], bench.ticks[seen:], strict=True):
        assert output.arming is ArmingState.FAULT
        assert output.reason is reason
        assert tick.reason == describe(output)
    assert detail in bench.outputs[seen].detail
    only_stops(bench, seen)
    stands(bench)


def only_stops(bench: ArmBench, seen: int) -> list[Request]:
    """From tick `seen` on only state 4 is commanded, first in that very tick; these requests."""
    requests = bench.requests(seen)
    stops = [request for request in requests if request.is_stop]
    others = [request for request in requests if not request.is_stop]
    assert stops[0].tick == seen, "sent in the tick in which the fault is seen"
    assert len(others) <= ONE_IN_FLIGHT
    assert all(request.is_motion and request.tick == seen for request in others)
    if isinstance(bench, LiveBench):
        assert {stop.connection for stop in stops}.isdisjoint(moving_connections(bench))
    return stops


def moving_connections(bench: ArmBench) -> set[int]:
    """The connections over which motion was ever commanded."""
    return {request.connection for request in bench.requests(0) if request.is_motion}


def stands(bench: ArmBench, ticks: int = 10) -> None:
    """The arm does not move while the control loop goes on for `ticks`."""
    first = bench.next
    bench.run(ticks)
    assert bench.travel_m(first) < STANDS_M


def recovers(bench: ArmBench, cause_gone: Callable[[], object] = lambda: None) -> None:
    """As the sentence says: free the arm, release the trigger, confirm; then arm it anew."""
    reason = bench.outputs[-1].reason
    assert reason is not None
    assert "confirm" in reason.sentence
    cause_gone()
    bench.signals.confirm()
    bench.run(3)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not while the trigger is held"
    bench.hand.trigger = 0.0
    bench.run(3)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not before somebody confirms"
    bench.signals.confirm()
    bench.run_until_state(ArmingState.DISARMED)
    stands(bench)
    bench.signals.confirm()
    bench.run_until_state(ArmingState.READY)
    reengages(bench)


def reengages(bench: ArmBench) -> None:
    """The hand is elsewhere by now; pressing moves nothing, and then the arm follows the hand."""
    bench.hand.velocity = np.zeros(3)
    bench.run(2)
    first = bench.next
    bench.hand.trigger = 1.0
    bench.run_until_state(ArmingState.ENGAGED)
    bench.run(20)
    assert bench.travel_m(first) < STILL_M
    start = bench.positions[-1]
    bench.hand.velocity = -SIDEWAYS
    bench.run(24)
    moved = bench.positions[-1] - start
    assert bench.outputs[-1].arming is ArmingState.ENGAGED, bench.ticks[-1].reason
    assert moved[1] < -0.005
    assert abs(moved[0]) + abs(moved[2]) < 0.001


def is_logged(
    bench: ArmBench, seen: int, reason: Reason, stopped_for: Reason | None = None
) -> None:
    """The log, written by the recorder and read back, tells the same story tick by tick.

    `stopped_for`: the hold that had stopped the arm before, if there was one.
    """
    log = bench.read_back()
    assert not log.truncated
    assert len(log.ticks) == len(bench.ticks)
    assert [tick.reason for tick in log.ticks] == [tick.reason for tick in bench.ticks]
    assert log.ticks[seen].reason.startswith(reason.label)
    assert log.ticks[seen].arming == ArmingState.FAULT.value
    stopping = stopped_for or reason
    stop = next(stop for stop in log.stops if stop.reason == stopping.label)
    first = next(tick for tick in log.ticks if tick.reason.startswith(stopping.label))
    assert stop.visible_ns == first.started_ns
    assert stop.stopped_ns is not None

"""What every fault must come to, judged by the wire, the records and the arm itself."""

from __future__ import annotations

import math

import numpy as np

from hw.sim.controller_codes import State
from tams_app.config import stop_time_s
from tams_app.recording import SessionLog
from tams_app.records import Tick, Vector
from tams_app.teleop.safety import ArmingState, Reason

from .bench import PERIOD_S, Bench

TICKS_TO_REST = 12  # 100 ms from full speed
STILL_M = 0.001  # the most an arm moves after it was engaged anew, before the hand moves
_ROUNDING = 1.01  # single precision on the wire
_CROSSES_M_S = 1e-6


def holds(bench: Bench, tick: int, reason: Reason) -> int:
    """In `tick` the arm begins to brake and holds for `reason`; ticks until it was told to rest."""
    assert bench.outputs[tick - 1].arming is ArmingState.ENGAGED
    assert bench.outputs[tick].arming is ArmingState.HOLDING
    assert bench.outputs[tick].reason is reason
    assert bench.ticks[tick].reason == reason.label
    return comes_to_rest(bench, tick)


def comes_to_rest(bench: Bench, tick: int, steady: bool = True) -> int:
    """From `tick` on the wire carries the stop profile, then exactly zero to the end.

    `steady`: the arm did not speed up just before; else that dies out within the stop profile.
    Returns how many ticks after `tick` the first command of zero goes out.
    """
    velocities = bench.velocities(tick - 2)
    speeds = np.linalg.norm(velocities[:, :3], axis=1)
    keeps_stop_profile(bench, velocities)
    limits = bench.config.limits
    dying_s = 0.0 if steady else limits.motion.acceleration_m_s2 / limits.stop.jerk_m_s3
    peak = speeds[1] + limits.motion.acceleration_m_s2 * dying_s / 2
    rises = speeds[2:] - np.minimum.accumulate(speeds[1:-1])
    assert rises.max() <= peak - speeds[1] + _CROSSES_M_S, "braking never speeds up"
    ticks = int(np.argmax(~velocities[2:].any(axis=1)))
    assert not velocities[2 + ticks :].any(), "zero stays zero"
    stop_s = stop_time_s(peak, limits.stop.acceleration_m_s2, limits.stop.jerk_m_s3)
    allowed = math.ceil((stop_s + dying_s) / PERIOD_S) + 1
    assert ticks <= allowed, "the stop profile is no slower than needed"
    return ticks


def keeps_stop_profile(bench: Bench, velocities: Vector) -> None:
    """No two of these commands in a row differ by more than the faster, the stop profile allows."""
    profile = bench.config.limits.stop
    accelerations = np.diff(velocities[:, :3], axis=0) / PERIOD_S
    jerks = np.diff(accelerations, axis=0) / PERIOD_S
    assert np.linalg.norm(accelerations, axis=1).max() <= profile.acceleration_m_s2 * _ROUNDING
    assert np.linalg.norm(jerks, axis=1).max() <= profile.jerk_m_s3 * _ROUNDING
    limit = bench.config.limits.max_speed_mm_s / 1000.0
    assert np.linalg.norm(velocities[:, :3], axis=1).max() <= limit * (1 + 1e-5)


def faults(bench: Bench, tick: int, reason: Reason) -> None:
    """In `tick` the arm is stopped with state 4 for `reason`, and no motion follows."""
    assert bench.outputs[tick - 1].arming is not ArmingState.FAULT
    assert bench.outputs[tick].arming is ArmingState.FAULT
    assert bench.outputs[tick].reason is reason
    assert bench.ticks[tick].reason.startswith(reason.label)
    requests = bench.model.since(tick)
    assert requests[0].tick == tick
    assert requests[0].is_stop, "the stop is the first thing said"
    assert not any(request.is_motion for request in requests)
    assert all(record.twist.is_zero for record in bench.ticks[tick:])
    state = bench.arm.state()
    assert state is not None
    assert state.state == State.STOPPED


def stands(bench: Bench, ticks: int = 30) -> None:
    """The arm does not move at all while the control loop goes on for `ticks`."""
    first = bench.next
    for _ in range(ticks):
        bench.tick()
    assert bench.travel_m(first) < 1e-9


def recovers_from_hold(bench: Bench, reason: Reason) -> None:
    """As the sentence says: the cause gone, release the trigger; then everything works again."""
    assert "release" in reason.sentence
    bench.run(0.3)
    assert bench.outputs[-1].arming is ArmingState.HOLDING, "held until the trigger is released"
    stands(bench)
    bench.hand.trigger = 0.0
    bench.run_until(ArmingState.READY)
    reengages(bench)


def recovers_from_fault(bench: Bench, reason: Reason) -> None:
    """As the sentence says: the cause gone, release the trigger, confirm; then arm it anew."""
    assert "confirm" in reason.sentence
    bench.signals.confirm()
    bench.run(0.2)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not while the trigger is held"
    bench.hand.trigger = 0.0
    bench.run(0.1)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not before somebody confirms"
    bench.signals.confirm()
    bench.run_until(ArmingState.DISARMED)
    stands(bench)
    bench.arm_it()
    reengages(bench)


def reengages(bench: Bench) -> None:
    """A hand at rest that presses the trigger moves nothing; when it moves, the arm follows."""
    before = bench.next
    bench.engage()
    bench.run(1.0)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    assert bench.travel_m(before) < STILL_M
    moving = bench.next
    bench.hand.velocity = np.array([0.0, -0.1, 0.0])
    bench.run(0.5)
    moved = bench.positions[-1] - bench.positions[moving - 1]
    assert moved[1] < -0.03
    assert abs(moved[0]) + abs(moved[2]) < 0.002


def is_logged(bench: Bench, reason: Reason) -> None:
    """The log, written by the recorder and read back, tells the same story tick by tick."""
    log: SessionLog = bench.read_back()
    assert not log.truncated
    assert [_story(tick) for tick in log.ticks] == [_story(tick) for tick in bench.ticks]
    assert reason.label in {tick.reason.split(":")[0] for tick in log.ticks}
    stop = next(stop for stop in log.stops if stop.reason == reason.label)
    assert stop.stopped_ns is not None
    assert stop.stopped_ns > stop.visible_ns


def _story(tick: Tick) -> tuple[object, ...]:
    twist = (*tick.twist.linear.tolist(), *tick.twist.angular.tolist())
    return tick.started_ns, tick.arming, tick.reason, tick.deadman, tick.speed_scale, twist

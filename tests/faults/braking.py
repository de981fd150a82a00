"""How an arm brakes for a hold, judged by the wire in virtual time."""

from __future__ import annotations

import math

import numpy as np

from tams_app.config import stop_time_s
from tams_app.records import Vector
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import PERIOD_S
from tests.faults.virtual_bench import VirtualBench

TICKS_TO_REST = 12  # 100 ms from full speed
_ROUNDING = 1.01  # single precision on the wire
_CROSSES_M_S = 1e-6


def holds(bench: VirtualBench, tick: int, reason: Reason) -> int:
    """In `tick` the arm begins to brake and holds for `reason`; ticks until it was told to rest."""
    assert bench.outputs[tick - 1].arming is ArmingState.ENGAGED
    assert bench.outputs[tick].arming is ArmingState.HOLDING
    assert bench.outputs[tick].reason is reason
    assert bench.ticks[tick].reason == reason.label
    return comes_to_rest(bench, tick)


def comes_to_rest(bench: VirtualBench, tick: int, steady: bool = True) -> int:
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


def keeps_stop_profile(bench: VirtualBench, velocities: Vector) -> None:
    """No two of these commands in a row differ by more than the faster, the stop profile allows."""
    profile = bench.config.limits.stop
    accelerations = np.diff(velocities[:, :3], axis=0) / PERIOD_S
    jerks = np.diff(accelerations, axis=0) / PERIOD_S
    assert np.linalg.norm(accelerations, axis=1).max() <= profile.acceleration_m_s2 * _ROUNDING
    assert np.linalg.norm(jerks, axis=1).max() <= profile.jerk_m_s3 * _ROUNDING
    limit = bench.config.limits.max_speed_mm_s / 1000.0
    assert np.linalg.norm(velocities[:, :3], axis=1).max() <= limit * (1 + 1e-5)

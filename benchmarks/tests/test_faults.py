"""The fault benchmark on traces whose answer is known: `python -m pytest benchmarks/tests`."""

import numpy as np
import pytest

from benchmarks.fault_controller import CYCLE, CYCLES, EVENT, EVENTS, Kind, Trace
from benchmarks.faults import Motion, Scenario
from tams_app.config import ArmConfig

pytestmark = pytest.mark.untimed

MS = 1_000_000
BEGIN_NS = 1_000 * MS
FAULT_NS = BEGIN_NS + 400 * MS
READY = np.radians(np.array(ArmConfig().ready_joints_deg))
RAD_PER_CYCLE = 0.001  # of the first joint: 0.35 mm of the TCP, which is 350 mm from its axis
RADIUS_MM = 350.0
CYCLES_AFTER_FAULT = 20
SCENARIO = Scenario("made up", "controller")


@pytest.fixture
def traced(tmp_path):
    """An arm that turns its base at a steady rate until 80 ms after the fault."""
    cycles = Trace(tmp_path / CYCLES, CYCLE)
    for cycle in range(250):
        turns = min(cycle, 100 + CYCLES_AFTER_FAULT)
        joints = READY + np.array([RAD_PER_CYCLE * turns, 0, 0, 0, 0, 0])
        cycles.append(BEGIN_NS + 4 * cycle * MS, joints)
    events = Trace(tmp_path / EVENTS, EVENT)

    def row(*happened):
        for after_ms, kind in happened:
            events.append(FAULT_NS + after_ms * MS, kind)
        return Motion(tmp_path).row(SCENARIO, FAULT_NS)

    return row


def test_travel_and_rest_are_counted_from_the_fault(traced):
    row = traced((-5, Kind.MOVE))
    assert row.travelled_mm == pytest.approx(
        RADIUS_MM * RAD_PER_CYCLE * (CYCLES_AFTER_FAULT + 1), rel=0.01
    )
    assert row.at_rest_ms == pytest.approx(80, abs=4)
    assert row.speed_mm_s == pytest.approx(RADIUS_MM * RAD_PER_CYCLE * 250, rel=0.01)


@pytest.mark.parametrize(
    ("happened", "zero_ms"),
    [
        ([(-8, Kind.MOVE)], 92),  # the controller's own deadman, 100 ms
        ([(-8, Kind.MOVE), (3, Kind.STOP)], 3),
        ([(-8, Kind.MOVE), (7, Kind.HALT)], 7),
        ([(-8, Kind.MOVE), (1, Kind.MOVE), (9, Kind.REST), (17, Kind.REST)], 9),
        ([(-90, Kind.STOP), (-8, Kind.MOVE), (1, Kind.MOVE), (9, Kind.STOP)], 9),
    ],
)
def test_zero_is_commanded_when_the_last_motion_in_force_ends(traced, happened, zero_ms):
    assert traced(*happened).zero_commanded_ms == pytest.approx(zero_ms)


def test_a_fault_that_takes_too_long_is_missed(traced):
    assert traced((-8, Kind.MOVE)).verdict == "met"
    assert traced((1, Kind.MOVE)).verdict == "missed"

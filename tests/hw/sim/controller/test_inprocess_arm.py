"""What the in-process arm adds to the contract of every arm (tests/contract/test_arm.py)."""

from __future__ import annotations

import numpy as np
import pytest

from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import CYCLE_NS, ControllerModel, IdealPlant
from tams_app.config import ArmConfig
from tams_app.records import ArmState, Twist
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

READY = np.radians(ArmConfig().ready_joints_deg)
SIDEWAYS = Twist(np.array([0.0, 0.05, 0.0]), np.zeros(3))


def enabled_arm(clock: VirtualClock) -> InProcessArm:
    arm = InProcessArm(ArmConfig(), clock, ControllerModel(IdealPlant(), READY))
    arm.connect()
    arm.enable()
    return arm


def state_of(arm: InProcessArm) -> ArmState:
    state = arm.state()
    assert state is not None
    return state


def test_reports_are_a_hundredth_of_a_second_apart() -> None:
    clock = VirtualClock()
    arm = enabled_arm(clock)
    seen = []
    for _ in range(500):
        clock.advance_ns(2 * NS_PER_MS)
        seen.append(state_of(arm).received_ns)
    times = np.unique(seen)
    assert len(times) in (100, 101)
    assert np.abs(np.diff(times)[1:] - NS_PER_S // 100).max() <= CYCLE_NS


def test_the_deadman_time_is_the_configuration_s() -> None:
    clock = VirtualClock()
    config = ArmConfig(velocity_deadman_s=0.5)
    arm = InProcessArm(config, clock, ControllerModel(IdealPlant(), READY))
    arm.connect()
    arm.enable()
    arm.send_twist(SIDEWAYS)
    clock.advance_ns(NS_PER_S)
    assert state_of(arm).tcp.position[1] == pytest.approx(0.025, abs=1e-3)


def test_what_passed_during_a_standstill_can_be_left_out() -> None:
    clock = VirtualClock()
    arm = enabled_arm(clock)
    arm.begin_move_to_joints((READY + np.array([0.5, 0, 0, 0, 0, 0])).tolist(), 0.25)
    clock.advance_ns(3600 * NS_PER_S)
    arm.skip_standstill(NS_PER_S)
    state = state_of(arm)
    assert 0.05 < state.joints[0] < 0.3
    assert state.received_ns > clock.now_ns() - 20 * NS_PER_MS

"""The controller is gone or talks nonsense: the arm holds or is in fault in that very tick."""

from __future__ import annotations

import pytest

from tams_app.records import ControllerStatus
from tams_app.teleop.safety import Reason
from tests.faults import distortions
from tests.faults.braking import TICKS_TO_REST, holds
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

HOLDS = {
    "tracking lost": (distortions.status(ControllerStatus.TRACKING_LOST), Reason.TRACKING_LOST),
    "invalid": (distortions.invalid, Reason.TRACKING_LOST),
    "standby": (distortions.status(ControllerStatus.STANDBY), Reason.CONTROLLER_STANDBY),
    "gaps": (distortions.status(ControllerStatus.LINK_GAPS), Reason.LINK_GAPS),
    "dashboard": (distortions.status(ControllerStatus.DASHBOARD), Reason.DASHBOARD_OPEN),
    "nan position": (distortions.nan_position, Reason.BAD_INPUT),
    "infinite position": (distortions.infinite_position, Reason.BAD_INPUT),
    "nan rotation": (distortions.nan_rotation, Reason.BAD_INPUT),
    "nan trigger": (distortions.nan_trigger, Reason.BAD_INPUT),
    "from the future": (distortions.from_the_future, Reason.BAD_INPUT),
}
FAULTS = {
    "controller lost": (
        distortions.status(ControllerStatus.DISCONNECTED),
        Reason.CONTROLLER_DISCONNECTED,
    ),
    "runtime killed": (distortions.status(ControllerStatus.RUNTIME_QUIT), Reason.RUNTIME_QUIT),
    "role swapped": (distortions.status(ControllerStatus.ROLE_SWAPPED), Reason.ROLE_SWAPPED),
    "recentred": (
        distortions.status(ControllerStatus.TRACKING_FRAME_CHANGED),
        Reason.TRACKING_FRAME_CHANGED,
    ),
}


@pytest.fixture
def bench(virtual_bench: VirtualBench) -> VirtualBench:
    return virtual_bench


@pytest.mark.parametrize(("distortion", "reason"), HOLDS.values(), ids=HOLDS)
def test_the_arm_brakes_in_the_tick_in_which_the_hand_is_lost(
    bench: VirtualBench, distortion: Distortion, reason: Reason
) -> None:
    bench.engage_and_move()
    lost = bench.next
    bench.hand.distortion = distortion
    bench.run(0.5)  # the hand itself moves on
    assert holds(bench, lost, reason) <= TICKS_TO_REST
    stands(bench)
    bench.hand.distortion = None
    bench.hand.velocity = 0.0 * bench.hand.velocity
    recovers_from_hold(bench, reason)
    is_logged(bench, reason)


@pytest.mark.parametrize(("distortion", "reason"), FAULTS.values(), ids=FAULTS)
def test_the_arm_is_stopped_in_the_tick_in_which_the_controller_is_gone(
    bench: VirtualBench, distortion: Distortion, reason: Reason
) -> None:
    bench.engage_and_move()
    lost = bench.next
    bench.hand.distortion = distortion
    bench.run(0.5)
    is_stopped(bench, lost, reason)
    bench.signals.confirm(bench.clock.now_ns())
    bench.hand.trigger = 0.0
    bench.run(0.5)
    is_stopped(bench, lost, reason)  # it cannot be confirmed away
    stands(bench)
    bench.hand.distortion = None
    bench.hand.velocity = 0.0 * bench.hand.velocity
    bench.hand.trigger = 1.0
    bench.run(3.5)  # a confirmation given too early does not count any more
    is_stopped(bench, lost, reason)
    if "start the session again" not in reason.lasting:
        recovers_from_fault(bench)
    is_logged(bench, reason)


@pytest.mark.parametrize("distortion", [entry[0] for entry in FAULTS.values()], ids=FAULTS)
def test_a_lost_controller_cannot_engage_an_arm_that_waits(
    bench: VirtualBench, distortion: Distortion
) -> None:
    bench.arm_it()
    bench.hand.distortion = distortion
    bench.hand.trigger = 1.0
    first = bench.next
    bench.run(0.5)
    assert not any(command is not None and command.any() for command in bench.commands(first))

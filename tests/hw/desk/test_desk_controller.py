"""What every device on a desk gives as a controller: how long it counts, and what is left of it."""

from __future__ import annotations

import pytest

from hw.desk.desk_controller import SILENT_NS, DeskController, Reading
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig, HandConfig
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

OK, STANDBY, DISCONNECTED = (
    ControllerStatus.OK,
    ControllerStatus.STANDBY,
    ControllerStatus.DISCONNECTED,
)
TICK_NS = 8 * NS_PER_MS
ALL_PRESSED = Deflection((1.0, 0.0, 0.0), trigger=1.0, grip=True, a=True, b=True, menu=True)


class Told(DeskController):
    """A device whose reading is what it was told."""

    def __init__(self, late_ns: int = 0) -> None:
        super().__init__(DeskConfig(), HandConfig().rotation)
        self.late_ns = late_ns
        self.told: Reading | None = None

    def start(self) -> None:
        """It is there."""

    def reading(self) -> Reading | None:
        return self.told

    def close(self) -> None:
        """It stays."""


def released(status: ControllerStatus, t_ns: int) -> ControllerSample:
    """Of a device that is missing; pose and buttons were new last at `t_ns`."""
    return ControllerSample(
        status, None, t_ns, t_ns, trigger=0.0, grip=0.0, a=False, b=False, menu=False
    )


@pytest.mark.parametrize("late_ms", [0, 100])
def test_a_silent_device_moves_the_hand_for_as_long_as_it_may_be_late_and_not_a_moment_longer(
    late_ms: int,
) -> None:
    device = Told(late_ms * NS_PER_MS)
    device.told = Reading(OK, NS_PER_S, ALL_PRESSED)
    limit_ns = NS_PER_S + SILENT_NS + late_ms * NS_PER_MS
    for now_ns in (*range(NS_PER_S, limit_ns, TICK_NS), limit_ns):
        last = device.sample(now_ns)
        assert last.pose is not None
        assert last.pose_ns == now_ns
        assert last.buttons_ns == min(now_ns, NS_PER_S + late_ms * NS_PER_MS)
    for now_ns in (limit_ns + 1, limit_ns + TICK_NS, limit_ns + NS_PER_S):
        assert device.sample(now_ns) == last


@pytest.mark.parametrize("status", [STANDBY, DISCONNECTED])
def test_a_device_that_goes_missing_has_nothing_pressed_and_keeps_its_times(
    status: ControllerStatus,
) -> None:
    device = Told()
    device.told = Reading(OK, NS_PER_S, ALL_PRESSED)
    sample = device.sample(NS_PER_S)
    assert (sample.trigger, sample.grip) == (1.0, 1.0)
    assert (sample.a, sample.b, sample.menu) == (True, True, True)
    device.told = Reading(status, 2 * NS_PER_S, ALL_PRESSED)
    assert device.sample(2 * NS_PER_S) == released(status, NS_PER_S)


def test_a_device_that_was_never_heard_of_has_no_times_nor_has_one_that_was_closed() -> None:
    device = Told()
    device.told = Reading(STANDBY, 0)
    assert device.sample(NS_PER_S) == released(STANDBY, 0)
    device.told = Reading(OK, NS_PER_S, ALL_PRESSED)
    assert device.sample(NS_PER_S).pose_ns == NS_PER_S
    device.told = None
    assert device.sample(NS_PER_S) == released(DISCONNECTED, 0)
    device.told = Reading(STANDBY, 0)
    assert device.sample(2 * NS_PER_S) == released(STANDBY, 0)


def test_a_device_that_is_found_again_begins_with_a_hand_that_rests() -> None:
    device = Told()
    for number in range(50):
        now_ns = NS_PER_S + number * TICK_NS
        device.told = Reading(OK, now_ns, ALL_PRESSED)
        moving = device.sample(now_ns)
    device.told = Reading(DISCONNECTED, now_ns)
    device.sample(now_ns)
    device.told = Reading(OK, now_ns + TICK_NS, ALL_PRESSED)
    first = device.sample(now_ns + TICK_NS)
    assert moving.pose is not None
    assert moving.pose.position.any()
    assert first.pose is not None
    assert not first.pose.position.any()

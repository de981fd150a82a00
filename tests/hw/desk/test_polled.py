"""The thread that reads a device: what becomes of its errors."""

from __future__ import annotations

import time

import pytest

from hw.desk.polled import PolledController, PolledDevice, beyond
from hw.desk.virtual_hand import NEUTRAL, Deflection
from hw.make_controller import DEVICES, make_controller
from tams_app.config import ClutchConfig, ControllerConfig, DeskConfig, HandConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerStatus, Haptic
from tams_app.runtime.clock import MonotonicClock
from tests.faults.applications import until

pytestmark = pytest.mark.waiting


class Device(PolledDevice):
    title = "wheel"

    def __init__(self) -> None:
        self.missing: Exception | None = None
        self.opened = self.closed = 0

    def open(self) -> None:
        self.opened += 1
        self._raise()

    def read(self) -> tuple[Deflection, int]:
        self._raise()
        return NEUTRAL, time.monotonic_ns()

    def pulse(self, haptic: Haptic) -> None:
        """None."""

    def close(self) -> None:
        self.closed += 1

    def _raise(self) -> None:
        if self.missing is not None:
            raise self.missing


def controller_of(device: Device, notes: list[tuple[str, str]]) -> PolledController:
    def note(level: str, text: str) -> None:
        notes.append((level, text))

    return PolledController(device, DeskConfig(), HandConfig().rotation, MonotonicClock(), note)


def status(controller: PolledController) -> ControllerStatus:
    return controller.sample(time.monotonic_ns()).status


def test_a_device_that_is_not_there_is_a_device_error_and_is_closed() -> None:
    device, notes = Device(), []
    device.missing = DeviceError("There is no wheel.")
    controller = controller_of(device, notes)
    with pytest.raises(DeviceError, match="no wheel"):
        controller.start()
    assert device.closed == 1
    assert status(controller) is ControllerStatus.DISCONNECTED
    controller.close()


def test_a_device_that_is_unplugged_and_plugged_in_again_is_told_twice_and_goes_on() -> None:
    device = Device()
    notes: list[tuple[str, str]] = []
    controller = controller_of(device, notes)
    controller.start()
    try:
        assert status(controller) is ControllerStatus.OK
        device.missing = DeviceError("The wheel was unplugged.")
        until(lambda: status(controller) is ControllerStatus.DISCONNECTED, "the loss")
        device.missing = None
        until(lambda: status(controller) is ControllerStatus.OK, "the device again")
        assert notes == [
            ("warning", "The wheel was unplugged."),
            ("info", "the wheel is there again"),
        ]
    finally:
        controller.close()
    assert status(controller) is ControllerStatus.DISCONNECTED


@pytest.mark.parametrize("while_driving", [False, True])
def test_an_error_that_no_driver_expects_is_told_and_is_a_controller_that_is_gone(
    while_driving: bool,
) -> None:
    device = Device()
    notes: list[tuple[str, str]] = []
    controller = controller_of(device, notes)
    broken = ZeroDivisionError("a driver's mistake")
    if while_driving:
        controller.start()
        device.missing = broken
    else:
        device.missing = broken
        with pytest.raises(ZeroDivisionError):
            controller.start()
    until(lambda: bool(notes), "the note")
    until(lambda: status(controller) is ControllerStatus.DISCONNECTED, "the loss")
    assert notes == [
        ("error", 'the wheel is read no more: ZeroDivisionError("a driver\'s mistake")')
    ]
    controller.close()


@pytest.mark.parametrize("device", sorted(DEVICES))
def test_every_device_of_the_configuration_makes_a_controller(device: str) -> None:
    config = ControllerConfig.model_validate({"device": device})
    made = make_controller(config, HandConfig(), ClutchConfig(), MonotonicClock(), lambda *_: None)
    assert made.sample(0).status is ControllerStatus.DISCONNECTED
    made.close()


def test_within_the_dead_zone_nothing_is_asked_and_beyond_it_grows_from_zero() -> None:
    assert beyond(0.2, 0.1, -0.1) == (0.0, 0.0)
    small, _ = beyond(0.2, 0.21, 0.0)
    assert 0.0 < small < 0.02
    assert beyond(0.2, 1.0, 0.0) == pytest.approx((1.0, 0.0))
    assert beyond(0.2, 1.0, 1.0) == pytest.approx((2**-0.5, 2**-0.5))

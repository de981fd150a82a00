"""The thread that reads a device: what becomes of its errors."""

from __future__ import annotations

import threading
import time
from itertools import pairwise

import pytest

from hw.desk import polled
from hw.desk.polled import PolledController, PolledDevice, beyond
from hw.desk.virtual_hand import NEUTRAL, Deflection
from hw.make_controller import DEVICES, make_controller
from tams_app.config import ClutchConfig, ControllerConfig, DeskConfig, HandConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerStatus, Haptic
from tams_app.runtime.clock import Clock, MonotonicClock, VirtualClock
from tams_app.units import NS_PER_S
from tests.faults.applications import until

pytestmark = pytest.mark.waiting


class Device(PolledDevice):
    title = "wheel"

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or MonotonicClock()
        self.asked = NEUTRAL
        self.missing: Exception | None = None
        self.unplugged = False  # until it is opened anew, which is refused so often
        self.refusals: list[str] = []
        self.opened_ns: list[int] = []
        self.lost_ns = self.closed = self.read_by = 0
        self.felt: list[Haptic] = []

    def open(self) -> None:
        self.opened_ns.append(self.clock.now_ns())
        self._raise()
        if self.unplugged and self.refusals:
            raise DeviceError(self.refusals.pop(0))
        self.unplugged = False

    def read(self) -> tuple[Deflection, int]:
        self.read_by = threading.get_native_id()
        self._raise()
        if self.unplugged:
            self.lost_ns = self.clock.now_ns()
            raise DeviceError("The wheel was unplugged.")
        return self.asked, self.clock.now_ns()

    def pulse(self, haptic: Haptic) -> None:
        self.felt.append(haptic)

    def close(self) -> None:
        self.closed += 1

    def _raise(self) -> None:
        if self.missing is not None:
            raise self.missing


def controller_of(device: Device, notes: list[tuple[str, str]]) -> PolledController:
    def note(level: str, text: str) -> None:
        notes.append((level, text))

    return PolledController(device, DeskConfig(), HandConfig().rotation, device.clock, note)


def status(controller: PolledController) -> ControllerStatus:
    return controller.sample(time.monotonic_ns()).status


def test_what_a_person_does_is_sampled_and_pulses_are_felt_until_it_is_closed() -> None:
    device = Device()
    device.asked = Deflection((1.0, 0.0, 0.0), trigger=1.0, a=True)
    controller = controller_of(device, [])
    controller.start()
    try:
        sample = controller.sample(time.monotonic_ns())
        assert (sample.trigger, sample.a, sample.b) == (1.0, True, False)
        controller.pulse(Haptic.LIMIT)
        until(lambda: bool(device.felt), "the pulse")
        assert controller.realtime_thread_ids == {"device-poll": device.read_by}
    finally:
        controller.close()
    assert device.closed == 1
    controller.pulse(Haptic.FAULT)
    assert device.felt == [Haptic.LIMIT]


def test_a_device_that_does_not_answer_is_told_and_closed_when_it_does_after_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers = threading.Event()

    class Slow(Device):
        def open(self) -> None:
            answers.wait(2.0)

    monkeypatch.setattr(polled, "_START_TIMEOUT_S", 0.02)
    device = Slow()
    controller = controller_of(device, [])
    with pytest.raises(DeviceError, match=r"^The wheel does not answer: unplug it"):
        controller.start()
    answers.set()
    until(lambda: device.closed == 1, "the end of the thread")
    controller.close()
    assert status(controller) is ControllerStatus.DISCONNECTED


def test_a_device_that_is_not_there_is_a_device_error_and_is_closed() -> None:
    device = Device()
    device.missing = DeviceError("There is no wheel.")
    controller = controller_of(device, [])
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
        last = controller.sample(time.monotonic_ns())
        assert last.status is ControllerStatus.OK
        device.missing = DeviceError("The wheel was unplugged.")
        until(lambda: status(controller) is ControllerStatus.DISCONNECTED, "the loss")
        missing = controller.sample(time.monotonic_ns())
        assert missing.pose_ns >= last.pose_ns > 0
        assert missing.buttons_ns >= last.buttons_ns > 0
        device.missing = None
        until(lambda: status(controller) is ControllerStatus.OK, "the device again")
        assert notes == [
            ("warning", "The wheel was unplugged."),
            ("info", "the wheel is there again"),
        ]
    finally:
        controller.close()
    assert status(controller) is ControllerStatus.DISCONNECTED


def test_a_device_that_is_gone_is_looked_for_each_half_second_and_each_new_reason_is_told() -> None:
    clock = VirtualClock()
    device = Device(clock)
    notes: list[tuple[str, str]] = []
    controller = controller_of(device, notes)
    controller.start()
    try:
        device.refusals = [*["There is no wheel."] * 3, "The wheel is in use."]
        device.unplugged = True
        until(lambda: len(notes) == 4, "the device again")
    finally:
        controller.close()
    assert notes == [
        ("warning", "The wheel was unplugged."),
        ("warning", "There is no wheel."),
        ("warning", "The wheel is in use."),
        ("info", "the wheel is there again"),
    ]
    tried_ns = [device.lost_ns, *device.opened_ns[1:]]
    assert [after - before for before, after in pairwise(tried_ns)] == [NS_PER_S // 2] * 5


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

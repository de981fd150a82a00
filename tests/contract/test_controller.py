"""What every controller keeps to: the simulated hand, here, from its process and over a link,
keyboard, and OpenVR's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack

import pytest

from hw.make_controller import DEVICES, make_controller
from tams_app.config import ControllerConfig, HandConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.runtime.clock import VirtualClock
from tams_app.teleop.clutch import Clutch
from tests.contract.controller_rigs import (
    FRESH_WITHIN_NS,
    ControllerRig,
    KeyboardRig,
    LinkRig,
    OpenVrRig,
    RemoteRig,
    VirtualControllerRig,
    is_in_use,
    is_released,
)
from tests.contract.faulty_controller import SensorFault

pytestmark = pytest.mark.waiting

STATUS_OF = {f: f.value for f in SensorFault if isinstance(f.value, ControllerStatus)}
WITH_POSE = {SensorFault.DASHBOARD}
WITH_BUTTONS = {  # that still stop the arm
    SensorFault.TRACKING_LOST,
    SensorFault.ROLE_SWAPPED,
    SensorFault.TRACKING_FRAME_CHANGED,
}


RIGS: dict[str, type[ControllerRig]] = {
    "virtual": VirtualControllerRig,
    "remote": RemoteRig,
    "link": LinkRig,
    "keyboard": KeyboardRig,
    "openvr": OpenVrRig,
}


@pytest.fixture(params=RIGS)
def rig(request: pytest.FixtureRequest) -> Iterator[ControllerRig]:
    with ExitStack() as cleaning:
        yield RIGS[request.param](cleaning)


def each_fault(faults: Iterable[SensorFault]) -> pytest.MarkDecorator:
    """Every rig with each of these faults that can come over it."""
    pairs = [
        pytest.param(name, fault, id=f"{name}-{fault.name}")
        for name, rig in RIGS.items()
        for fault in faults
        if fault in rig.faults
    ]
    return pytest.mark.parametrize(("rig", "fault"), pairs, indirect=["rig"])


@pytest.fixture
def held(rig: ControllerRig) -> ControllerRig:
    """Started and in use: the trigger is held, pose and buttons are fresh."""
    rig.controller.start()
    rig.until(is_in_use)
    return rig


def works_again(held: ControllerRig) -> None:
    """Once what it suffered has ended."""
    held.inject(None)
    asked_ns = held.advance()
    held.until(lambda s: is_in_use(s) and min(s.pose_ns, s.buttons_ns) >= asked_ns)


def is_away(sample: ControllerSample) -> bool:
    is_disconnected = sample.status is ControllerStatus.DISCONNECTED
    return is_disconnected and sample.pose is None and is_released(sample)


def test_one_that_was_not_started_is_disconnected_and_released(rig: ControllerRig) -> None:
    assert is_away(rig.sample())


def test_the_first_sample_after_the_start_is_fresh(rig: ControllerRig) -> None:
    rig.controller.start()
    before_ns = rig.advance()
    sample = rig.until(lambda sample: sample.pose_ns >= before_ns)
    assert sample.status is ControllerStatus.OK
    assert sample.pose is not None


def test_pose_and_buttons_stay_fresh(held: ControllerRig) -> None:
    for _ in range(20):
        asked_ns = held.advance()
        sample = held.until(lambda s, a=asked_ns: min(s.pose_ns, s.buttons_ns) >= a)
        assert is_in_use(sample)


def test_times_never_go_back_and_never_lie_ahead(held: ControllerRig) -> None:
    pose_ns = buttons_ns = 0
    for _ in range(30):
        now_ns = held.advance()
        sample = held.controller.sample(now_ns)
        assert pose_ns <= sample.pose_ns <= now_ns + FRESH_WITHIN_NS
        assert buttons_ns <= sample.buttons_ns <= now_ns + FRESH_WITHIN_NS
        pose_ns, buttons_ns = sample.pose_ns, sample.buttons_ns


def test_after_closing_everything_is_released_and_pulses_are_harmless(held: ControllerRig) -> None:
    held.controller.close()
    held.controller.close()
    held.controller.pulse(Haptic.FAULT)
    assert is_away(held.sample())


def test_one_that_was_closed_can_be_started_again(held: ControllerRig) -> None:
    held.controller.close()
    held.controller.start()
    asked_ns = held.advance()
    held.until(lambda s: is_in_use(s) and min(s.pose_ns, s.buttons_ns) >= asked_ns)


def test_closing_what_was_never_started_is_harmless(rig: ControllerRig) -> None:
    rig.controller.close()
    assert is_away(rig.sample())


def test_a_tap_between_two_samples_has_been_pressed_once(held: ControllerRig) -> None:
    clutch = Clutch(FRESH_WITHIN_NS)
    edges = 0

    def seen(sample: ControllerSample) -> bool:
        nonlocal edges
        read = clutch.update(sample, max(sample.buttons_ns, sample.pose_ns))
        edges += read.close_gripper or read.open_gripper
        return sample.presses.a + sample.presses.b >= taps

    taps = 0
    held.until(seen)
    for _ in range(5):
        taps += 1
        held.tap()
        held.until(seen)
        assert not held.sample().a
    for _ in range(10):
        seen(held.sample())
    assert edges == taps


@each_fault(STATUS_OF)
def test_missing_input_is_a_status_reads_as_released_and_its_times_stand_still_until_it_ends(
    held: ControllerRig, fault: SensorFault
) -> None:
    held.inject(fault)
    first = held.until(lambda sample: sample.status is STATUS_OF[fault])
    assert (first.pose is not None) == (fault in WITH_POSE)
    if fault is not SensorFault.TRACKING_LOST:  # whose buttons are known, and go on
        assert is_released(first)
    for _ in range(5):
        sample = held.sample()
        if fault not in WITH_POSE:
            assert sample.pose_ns == first.pose_ns
        if fault not in WITH_BUTTONS:
            assert sample.buttons_ns == first.buttons_ns
    works_again(held)


@each_fault([SensorFault.FROZEN_POSE])
def test_a_frozen_pose_keeps_its_time_while_the_buttons_go_on(
    held: ControllerRig, fault: SensorFault
) -> None:
    held.inject(fault)
    first = held.until(lambda sample: sample.pose_ns < sample.buttons_ns)
    sample = held.until(lambda sample: sample.buttons_ns > first.buttons_ns + FRESH_WITHIN_NS)
    assert sample.status is ControllerStatus.OK
    assert sample.pose is first.pose
    assert sample.pose_ns == first.pose_ns
    assert sample.trigger == 1.0
    works_again(held)


@each_fault([SensorFault.FROZEN_BUTTONS])
def test_frozen_buttons_keep_their_time_while_the_pose_goes_on(
    held: ControllerRig, fault: SensorFault
) -> None:
    held.inject(fault)
    first = held.until(lambda sample: sample.buttons_ns < sample.pose_ns)
    sample = held.until(lambda sample: sample.pose_ns > first.pose_ns + FRESH_WITHIN_NS)
    assert sample.status is ControllerStatus.OK
    assert sample.buttons_ns == first.buttons_ns
    assert sample.trigger == 1.0
    works_again(held)


def test_a_device_that_falls_silent_while_it_is_held_stands_still_and_becomes_stale(
    held: ControllerRig,
) -> None:
    now_ns, stale = held.advance(), False
    for number in range(150):  # at least 1.2 s
        now_ns = held.advance()
        sample = held.controller.sample(now_ns)
        if number == 20:
            held.fall_silent()
        stale = now_ns - min(sample.pose_ns, sample.buttons_ns) > FRESH_WITHIN_NS
    assert stale
    stood = sample
    for _ in range(30):
        sample = held.sample()
        assert sample.pose is stood.pose
        assert sample.pose_ns == stood.pose_ns


@pytest.mark.parametrize("haptic", Haptic)
def test_pulses_reach_the_hand(held: ControllerRig, haptic: Haptic) -> None:
    held.controller.pulse(haptic)
    if not held.can_be_felt:
        assert is_in_use(held.sample())
        return
    held.until(lambda _: held.felt() > 0)


def test_pulses_before_the_start_go_nowhere(rig: ControllerRig) -> None:
    rig.controller.pulse(Haptic.FAULT)
    rig.controller.start()
    rig.until(is_in_use)
    for _ in range(10):
        rig.advance()
    assert rig.felt() == 0


@each_fault([SensorFault.DISCONNECTED])
def test_a_pulse_to_a_controller_that_is_gone_is_harmless(
    held: ControllerRig, fault: SensorFault
) -> None:
    held.inject(fault)
    held.until(lambda sample: sample.status is ControllerStatus.DISCONNECTED)
    held.controller.pulse(Haptic.FAULT)
    assert held.sample().status is ControllerStatus.DISCONNECTED


def test_a_start_with_nothing_to_connect_to_is_a_device_error() -> None:
    with ExitStack() as cleaning:
        rig = OpenVrRig(cleaning)
        rig.runtime.running = False
        with pytest.raises(DeviceError, match="SteamVR"):
            rig.controller.start()
        assert rig.sample().status is ControllerStatus.DISCONNECTED
        rig.runtime.running = True
        rig.controller.start()
        rig.until(is_in_use)


@pytest.mark.parametrize("device", DEVICES)
def test_every_device_of_the_configuration_makes_a_controller(device: str) -> None:
    config = ControllerConfig(device=device)
    made = make_controller(config, HandConfig(), VirtualClock(), lambda *_: None)
    assert made.sample(0).status is ControllerStatus.DISCONNECTED
    made.close()

"""The radio of a device on the desk dies while it drives: its last report drives no further."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest

from hw.desk.desk_controller import DeskController, Reading
from hw.desk.gamepad import Gamepad, sdl2
from hw.desk.polled import PolledDevice
from hw.desk.spacemouse import SpaceMouse
from tams_app.config import DeskConfig
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import PERIOD_S
from tests.faults.braking import TICKS_TO_REST
from tests.faults.promises import stands
from tests.faults.virtual_bench import VirtualBench
from tests.hw.desk.fake_mouse import LEFT, FakeMouse, axes_report, buttons_report
from tests.hw.desk.virtual_pad import VirtualPad

pytestmark = pytest.mark.waiting  # SDL

BY_RADIO = DeskConfig(wireless=True)
TRIGGER, LEFT_Y = sdl2.SDL_CONTROLLER_AXIS_TRIGGERRIGHT, sdl2.SDL_CONTROLLER_AXIS_LEFTY


class ReadInTheTick(DeskController):
    """A driver without its thread."""

    def __init__(self, device: PolledDevice, bench: VirtualBench) -> None:
        super().__init__(BY_RADIO, bench.config.hand.rotation)
        self._device = device

    def start(self) -> None:
        self._device.open()

    def reading(self) -> Reading:
        deflection, known_ns = self._device.read()
        return Reading(ControllerStatus.OK, known_ns, deflection)

    def close(self) -> None:
        self._device.close()


@dataclass
class Driven:
    """An arm and a device: `report` is told in each tick how far it is pushed, and the deadman."""

    bench: VirtualBench
    report: Callable[[float, bool], None]
    bound_s: float
    push: float = 0.0
    deadman: bool = False
    radio: bool = True

    def sample(self, controller: DeskController) -> ControllerSample:
        if self.radio:
            self.report(self.push, self.deadman)
        return controller.sample(self.bench.clock.now_ns())


@pytest.fixture(params=["spacemouse", "gamepad"])
def driven(request: pytest.FixtureRequest, virtual_bench: VirtualBench) -> Iterator[Driven]:
    bench = virtual_bench
    with ExitStack() as stack:
        made = _mouse(bench, stack) if request.param == "spacemouse" else _pad(bench, stack)
        yield made


def _mouse(bench: VirtualBench, stack: ExitStack) -> Driven:
    mouse = FakeMouse()
    stack.enter_context(mouse.in_place_of_hidapi())

    def report(push: float, deadman: bool) -> None:
        mouse.waiting += [buttons_report(LEFT * deadman), axes_report(1, 0, -round(350 * push), 0)]

    return _driven(bench, stack, SpaceMouse(BY_RADIO, bench.clock.now_ns), report, 0.1)


def _pad(bench: VirtualBench, stack: ExitStack) -> Driven:
    pad = VirtualPad()
    pad.plug_in()
    stack.callback(pad.unplug)
    tremble = 0.0

    def report(push: float, deadman: bool) -> None:
        nonlocal tremble
        tremble = 0.002 - tremble
        pad.move(LEFT_Y, -push * (1 - tremble))
        pad.move(TRIGGER, 2.0 * deadman * (1 - tremble) - 1.0)

    device = Gamepad(BY_RADIO, bench.clock.now_ns)
    return _driven(bench, stack, device, report, BY_RADIO.unchanged_ms / 1000)


def _driven(
    bench: VirtualBench,
    stack: ExitStack,
    device: PolledDevice,
    report: Callable[[float, bool], None],
    bound_s: float,
) -> Driven:
    controller = ReadInTheTick(device, bench)
    controller.start()
    stack.callback(controller.close)
    made = Driven(bench, report, bound_s)
    bench.hand.distortion = lambda true, last: made.sample(controller)
    return made


def test_a_device_whose_radio_dies_while_it_drives_holds_the_arm_within_its_bound(
    driven: Driven,
) -> None:
    bench = driven.bench
    bench.arm_it()
    driven.deadman = True
    bench.run_until_state(ArmingState.ENGAGED)
    first = bench.next
    driven.push = 1.0
    bench.run(1.0)
    assert bench.travel_m(first) > 0.05
    driven.radio = False
    silent = bench.next
    held = bench.run_until(lambda output: output.arming is ArmingState.HOLDING)
    assert bench.outputs[held].reason is Reason.BUTTONS_STALE
    assert held - silent <= round(driven.bound_s / PERIOD_S) + 1
    bench.run_ticks(TICKS_TO_REST)
    stands(bench)
    bench.run(10.0)
    assert bench.travel_m(held + TICKS_TO_REST + 1) < 1e-9
    driven.radio, driven.push = True, 0.0
    bench.run(0.3)
    assert bench.outputs[-1].arming is ArmingState.HOLDING, "held until the deadman is released"
    driven.deadman = False
    bench.run_until_state(ArmingState.READY)

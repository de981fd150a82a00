"""The gamepad's driver with the real SDL, which simulates the pad."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hw.desk.gamepad import Gamepad, sdl2
from hw.desk.virtual_hand import NEUTRAL
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic
from tams_app.vectors import Floats3
from tests.hw.desk.virtual_pad import VirtualPad

pytestmark = pytest.mark.waiting

LEFT_X, LEFT_Y = sdl2.SDL_CONTROLLER_AXIS_LEFTX, sdl2.SDL_CONTROLLER_AXIS_LEFTY
RIGHT_X, RIGHT_Y = sdl2.SDL_CONTROLLER_AXIS_RIGHTX, sdl2.SDL_CONTROLLER_AXIS_RIGHTY
TRIGGER = sdl2.SDL_CONTROLLER_AXIS_TRIGGERRIGHT


@pytest.fixture
def pad() -> Iterator[VirtualPad]:
    made = VirtualPad()
    made.plug_in()
    yield made
    made.unplug()


@pytest.fixture
def opened(pad: VirtualPad) -> Iterator[Gamepad]:
    gamepad = Gamepad(DeskConfig())
    gamepad.open()
    yield gamepad
    gamepad.close()


def test_a_pad_that_rests_asks_for_nothing(opened: Gamepad) -> None:
    assert opened.read() == NEUTRAL


@pytest.mark.parametrize(
    ("axis", "to", "linear", "angular"),
    [
        (LEFT_Y, -1.0, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),  # pushed away: SDL's y goes down
        (LEFT_Y, 1.0, (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        (LEFT_X, -1.0, (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
        (LEFT_X, 1.0, (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),
        (RIGHT_Y, -1.0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
        (RIGHT_X, -1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    ],
)
def test_each_stick_asks_for_its_axes(
    pad: VirtualPad, opened: Gamepad, axis: int, to: float, linear: Floats3, angular: Floats3
) -> None:
    pad.move(axis, to)
    asked = opened.read()
    assert asked.linear == pytest.approx(linear, abs=1e-3)
    assert asked.angular == pytest.approx(angular, abs=1e-3)
    assert asked.trigger == 0.0


def test_a_stick_that_does_not_quite_come_back_rests(pad: VirtualPad, opened: Gamepad) -> None:
    pad.move(LEFT_X, 0.08)
    pad.move(LEFT_Y, -0.08)
    assert opened.read() == NEUTRAL


@pytest.mark.parametrize(("to", "trigger"), [(-1.0, 0.0), (0.0, 0.5), (1.0, 1.0)])
def test_the_right_trigger_is_the_deadman(
    pad: VirtualPad, opened: Gamepad, to: float, trigger: float
) -> None:
    pad.move(TRIGGER, to)
    assert opened.read().trigger == pytest.approx(trigger, abs=0.01)


@pytest.mark.parametrize(
    ("button", "name"),
    [
        (sdl2.SDL_CONTROLLER_BUTTON_LEFTSHOULDER, "grip"),
        (sdl2.SDL_CONTROLLER_BUTTON_A, "a"),
        (sdl2.SDL_CONTROLLER_BUTTON_B, "b"),
        (sdl2.SDL_CONTROLLER_BUTTON_START, "menu"),
    ],
)
def test_each_button_is_one_of_the_hands(
    pad: VirtualPad, opened: Gamepad, button: int, name: str
) -> None:
    pad.press(button)
    asked = opened.read()
    assert [one for one in ("grip", "a", "b", "menu") if getattr(asked, one)] == [name]
    pad.press(button, down=False)
    assert opened.read() == NEUTRAL


def test_a_pad_that_is_unplugged_is_a_device_error_and_can_be_opened_again(
    pad: VirtualPad, opened: Gamepad
) -> None:
    pad.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        opened.read()
    opened.close()
    with pytest.raises(DeviceError, match="no gamepad"):
        opened.open()
    pad.plug_in()
    opened.open()
    assert opened.read() == NEUTRAL


def test_only_a_pad_of_the_configured_name_is_taken(pad: VirtualPad) -> None:
    other = Gamepad(DeskConfig(name="no such pad"))
    with pytest.raises(DeviceError, match="no such pad"):
        other.open()
    named = Gamepad(DeskConfig(name="virtual"))
    named.open()
    named.close()


@pytest.mark.parametrize("haptic", Haptic)
def test_a_pad_without_motors_takes_every_pulse(opened: Gamepad, haptic: Haptic) -> None:
    opened.pulse(haptic)
    assert opened.read() == NEUTRAL

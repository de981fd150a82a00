"""The gamepad's driver with the real SDL, which simulates the pad."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hw.desk.gamepad import Gamepad, sdl2
from hw.desk.virtual_hand import NEUTRAL, Deflection
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic, Presses
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import Floats3
from tests.hw.desk.virtual_pad import VirtualPad

pytestmark = pytest.mark.waiting

LEFT_X, LEFT_Y = sdl2.SDL_CONTROLLER_AXIS_LEFTX, sdl2.SDL_CONTROLLER_AXIS_LEFTY
RIGHT_X, RIGHT_Y = sdl2.SDL_CONTROLLER_AXIS_RIGHTX, sdl2.SDL_CONTROLLER_AXIS_RIGHTY
TRIGGER = sdl2.SDL_CONTROLLER_AXIS_TRIGGERRIGHT
ON_CABLE = DeskConfig(wireless=False)  # SDL does not know it of a pad that it simulates
WIRED, UNKNOWN = sdl2.SDL_JOYSTICK_POWER_WIRED, sdl2.SDL_JOYSTICK_POWER_UNKNOWN
BATTERY = sdl2.SDL_JOYSTICK_POWER_MEDIUM


@pytest.fixture
def pad() -> Iterator[VirtualPad]:
    made = VirtualPad()
    made.plug_in()
    yield made
    made.unplug()


@pytest.fixture
def sdl_not_started() -> None:
    """SDL as a driver finds it that is the first to use it."""
    while sdl2.SDL_WasInit(sdl2.SDL_INIT_GAMECONTROLLER):
        sdl2.SDL_QuitSubSystem(sdl2.SDL_INIT_GAMECONTROLLER)


@pytest.fixture
def opened(pad: VirtualPad) -> Iterator[Gamepad]:
    gamepad = Gamepad(ON_CABLE, lambda: 0)
    gamepad.open()
    yield gamepad
    gamepad.close()


def test_a_pad_that_rests_asks_for_nothing(opened: Gamepad) -> None:
    assert opened.read()[0] == NEUTRAL


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
    asked, _ = opened.read()
    assert asked.linear == pytest.approx(linear, abs=1e-3)
    assert asked.angular == pytest.approx(angular, abs=1e-3)
    assert asked.trigger == 0.0


def test_a_stick_that_does_not_quite_come_back_rests(pad: VirtualPad, opened: Gamepad) -> None:
    pad.move(LEFT_X, 0.08)
    pad.move(LEFT_Y, -0.08)
    assert opened.read()[0] == NEUTRAL


def test_the_most_that_an_axis_can_say_is_full_deflection(pad: VirtualPad, opened: Gamepad) -> None:
    """-32768, where full on the other side is 32767."""
    pad.move(LEFT_X, -1.0)
    pad.move(LEFT_Y, 0.5)
    full, _ = opened.read()
    pad.move(LEFT_X, -32768 / 32767)
    assert opened.read()[0] == full


@pytest.mark.parametrize("to", [-1.0, -0.99, -0.97])
def test_a_trigger_that_does_not_quite_come_back_is_released(
    pad: VirtualPad, opened: Gamepad, to: float
) -> None:
    pad.move(TRIGGER, to)
    assert opened.read()[0].trigger == 0.0
    pad.move(TRIGGER, -0.9)
    assert opened.read()[0].trigger == pytest.approx(0.05, abs=0.001)


@pytest.mark.parametrize(("to", "trigger"), [(-1.0, 0.0), (0.0, 0.5), (1.0, 1.0)])
def test_the_right_trigger_is_the_deadman(
    pad: VirtualPad, opened: Gamepad, to: float, trigger: float
) -> None:
    pad.move(TRIGGER, to)
    assert opened.read()[0].trigger == pytest.approx(trigger, abs=0.01)


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
    asked, _ = opened.read()
    assert [one for one in ("grip", "a", "b", "menu") if getattr(asked, one)] == [name]
    assert asked.presses == Presses(**{name: 1})
    pad.press(button, down=False)
    assert opened.read()[0] == Deflection(presses=asked.presses)


def test_every_tap_between_two_readings_counts_and_events_do_not_pile_up(
    pad: VirtualPad, opened: Gamepad
) -> None:
    for number in range(1, 41):
        for down in (True, False):
            pad.press(sdl2.SDL_CONTROLLER_BUTTON_A, down)
            sdl2.SDL_GameControllerUpdate()
        pad.move(LEFT_X, number / 100)
        asked, _ = opened.read()
        assert (asked.a, asked.presses) == (False, Presses(a=number))
    first, last = sdl2.SDL_FIRSTEVENT, sdl2.SDL_LASTEVENT
    assert sdl2.SDL_PeepEvents(None, 0, sdl2.SDL_PEEKEVENT, first, last) == 0


def test_a_press_that_is_the_only_thing_sdl_has_to_say_counts(
    pad: VirtualPad, opened: Gamepad
) -> None:
    pad.press(sdl2.SDL_CONTROLLER_BUTTON_A)
    sdl2.SDL_GameControllerUpdate()
    event, down = sdl2.SDL_Event(), sdl2.SDL_CONTROLLERBUTTONDOWN
    assert sdl2.SDL_PeepEvents(event, 1, sdl2.SDL_GETEVENT, down, down) == 1
    sdl2.SDL_FlushEvents(sdl2.SDL_FIRSTEVENT, sdl2.SDL_LASTEVENT)
    assert sdl2.SDL_PushEvent(event) == 1
    assert opened.read()[0].presses == Presses(a=1)


def test_a_tap_that_comes_while_others_are_read_counts_too(
    pad: VirtualPad, opened: Gamepad
) -> None:
    done = threading.Event()

    def read_all_the_time() -> None:
        while not done.is_set():
            opened.read()

    reader = threading.Thread(target=read_all_the_time)
    reader.start()
    try:
        for _ in range(300):
            for down in (True, False):
                pad.press(sdl2.SDL_CONTROLLER_BUTTON_A, down)
                sdl2.SDL_GameControllerUpdate()
    finally:
        done.set()
        reader.join()
    assert opened.read()[0].presses == Presses(a=300)


def test_a_pad_that_is_unplugged_is_a_device_error_and_can_be_opened_again(
    pad: VirtualPad, opened: Gamepad
) -> None:
    pad.unplug()
    with pytest.raises(DeviceError, match=r"^The gamepad was unplugged: plug it in again\.$"):
        opened.read()
    opened.close()
    with pytest.raises(DeviceError, match=r"^There is no gamepad: plug one in, or choose another"):
        opened.open()
    pad.plug_in()
    opened.open()
    assert opened.read()[0] == NEUTRAL


def test_a_pad_that_was_never_opened_is_a_device_error_and_may_be_closed(pad: VirtualPad) -> None:
    gamepad = Gamepad(ON_CABLE, lambda: 0)
    with pytest.raises(DeviceError, match="plug it in"):
        gamepad.read()
    gamepad.close()


def test_a_pad_that_is_closed_is_let_go(pad: VirtualPad, opened: Gamepad) -> None:
    number = sdl2.SDL_JoystickGetDeviceInstanceID(0)
    assert sdl2.SDL_GameControllerFromInstanceID(number)
    opened.close()
    assert not sdl2.SDL_GameControllerFromInstanceID(number)
    with pytest.raises(DeviceError):
        opened.read()


def catches_sigterm() -> bool:
    """Whether anything in this process does, by the kernel."""
    status = Path("/proc/self/status").read_text("ascii")
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.usefixtures("sdl_not_started")
def test_sdl_is_started_once_leaves_signals_alone_and_hears_pads_without_a_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("SDL_NO_SIGNAL_HANDLERS", raising=False)
    sdl2.SDL_SetHint(sdl2.SDL_HINT_JOYSTICK_ALLOW_BACKGROUND_EVENTS, b"0")
    caught_before = catches_sigterm()
    gamepad = Gamepad(ON_CABLE, lambda: 0)
    for _ in range(3):
        with pytest.raises(DeviceError, match="no gamepad"):
            gamepad.open()
    assert catches_sigterm() == caught_before
    for hint in (b"SDL_NO_SIGNAL_HANDLERS", sdl2.SDL_HINT_JOYSTICK_ALLOW_BACKGROUND_EVENTS):
        assert sdl2.SDL_GetHint(hint) == b"1"
    assert sdl2.SDL_WasInit(sdl2.SDL_INIT_GAMECONTROLLER)
    sdl2.SDL_QuitSubSystem(sdl2.SDL_INIT_GAMECONTROLLER)
    assert not sdl2.SDL_WasInit(sdl2.SDL_INIT_GAMECONTROLLER)


def test_why_sdl_does_not_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sdl2, "SDL_InitSubSystem", lambda flags: sdl2.SDL_SetError(b"no udev"))
    with pytest.raises(DeviceError, match=r"^SDL finds no gamepads: no udev\.$"):
        Gamepad(ON_CABLE, lambda: 0).open()


@pytest.mark.parametrize(
    ("name", "wanted", "is_taken"),
    [
        (b"Pad\xff", "pad", True),  # no UTF-8
        (b"Pad\xff", "stick", False),
        (None, "", True),  # SDL does not know it
        (None, "x", False),
    ],
)
def test_a_pad_with_an_odd_name_or_none_is_no_problem(
    pad: VirtualPad,
    monkeypatch: pytest.MonkeyPatch,
    name: bytes | None,
    wanted: str,
    is_taken: bool,
) -> None:
    monkeypatch.setattr(sdl2, "SDL_JoystickNameForIndex", lambda index: name)
    gamepad = Gamepad(DeskConfig(name=wanted, wireless=False), lambda: 0)
    if is_taken:
        gamepad.open()
        assert gamepad.read()[0] == NEUTRAL
        gamepad.close()
    else:
        with pytest.raises(DeviceError, match=f"whose name has '{wanted}' in it"):
            gamepad.open()


def test_only_a_pad_of_the_configured_name_is_taken(pad: VirtualPad) -> None:
    other = Gamepad(DeskConfig(name="no such pad"), lambda: 0)
    with pytest.raises(DeviceError, match="no such pad"):
        other.open()
    named = Gamepad(DeskConfig(name="virtual", wireless=False), lambda: 0)
    named.open()
    named.close()


@pytest.mark.parametrize("haptic", Haptic)
def test_every_pulse_is_felt(pad: VirtualPad, opened: Gamepad, haptic: Haptic) -> None:
    opened.pulse(haptic)
    assert pad.rumbles == 1
    assert opened.read()[0] == NEUTRAL


UNKNOWN_SENTENCE = (
    "It is not known whether the gamepad 'Virtual Controller' is on a cable: say so with "
    "controller.desk.wireless, false on a cable, true by radio, where what is held without a "
    "change counts for 500 ms."
)
BATTERY_SENTENCE = (
    "The gamepad 'Virtual Controller' runs on its battery: use a cable, or set "
    "controller.desk.wireless to true; what is held without a change then counts for 500 ms."
)


@pytest.mark.parametrize(
    ("level", "wireless", "refusal"),
    [
        (WIRED, None, ""),
        (WIRED, True, ""),
        (WIRED, False, ""),
        (UNKNOWN, None, UNKNOWN_SENTENCE),
        (UNKNOWN, True, ""),
        (UNKNOWN, False, ""),
        (BATTERY, None, BATTERY_SENTENCE),
        (BATTERY, True, ""),
        (BATTERY, False, BATTERY_SENTENCE),
    ],
)
def test_a_pad_that_is_not_known_to_be_on_a_cable_is_refused_unless_it_is_declared(
    pad: VirtualPad,
    monkeypatch: pytest.MonkeyPatch,
    level: int,
    wireless: bool | None,
    refusal: str,
) -> None:
    def level_of(joystick: Any) -> int:
        assert sdl2.SDL_JoystickName(joystick) == b"Virtual Controller"
        return level

    monkeypatch.setattr(sdl2, "SDL_JoystickCurrentPowerLevel", level_of)
    gamepad = Gamepad(DeskConfig(wireless=wireless), lambda: 0)
    if refusal:
        with pytest.raises(DeviceError, match=f"^{re.escape(refusal)}$"):
            gamepad.open()
    else:
        gamepad.open()
        assert gamepad.read()[0] == NEUTRAL
    gamepad.close()


@pytest.mark.parametrize("unchanged_ms", [100, 500, 2000])
def test_what_a_pad_by_radio_holds_without_a_change_is_stale_after_the_configured_time(
    pad: VirtualPad, unchanged_ms: float
) -> None:
    now_ns = NS_PER_S
    gamepad = Gamepad(DeskConfig(wireless=True, unchanged_ms=unchanged_ms), lambda: now_ns)
    gamepad.open()
    pad.move(LEFT_Y, -1.0)
    for _ in range(3):
        now_ns += NS_PER_S
        assert gamepad.read()[1] == now_ns  # with the deadman up it may rest as long as it likes
    pad.move(TRIGGER, 1.0)
    for _ in range(20):  # while anything changes the deadman counts
        pad.move(RIGHT_X, 0.001 if gamepad.read()[1] % 2 else 0.002)
        now_ns += round(unchanged_ms / 2) * NS_PER_MS + 1
        assert gamepad.read()[1] == now_ns
    changed_ns = now_ns
    for age_ms in range(0, 5000, 8):
        now_ns = changed_ns + age_ms * NS_PER_MS
        asked, known_ns = gamepad.read()
        is_stale = now_ns - known_ns > 100 * NS_PER_MS
        assert is_stale == (age_ms > unchanged_ms)
        assert asked.trigger == 1.0
    pad.move(TRIGGER, 0.99)
    assert gamepad.read()[1] == now_ns
    for button in range(sdl2.SDL_CONTROLLER_BUTTON_TOUCHPAD):  # which SDL does not simulate
        for down in (True, False):
            now_ns += 5 * NS_PER_S
            assert gamepad.read()[1] < now_ns - 100 * NS_PER_MS
            pad.press(button, down)
            assert gamepad.read()[1] == now_ns
    gamepad.close()


def test_a_pad_on_a_cable_may_be_held_for_as_long_as_it_is_plugged_in(pad: VirtualPad) -> None:
    now_ns = NS_PER_S
    gamepad = Gamepad(ON_CABLE, lambda: now_ns)
    gamepad.open()
    pad.move(TRIGGER, 1.0)
    for _ in range(100):
        now_ns += NS_PER_S
        assert gamepad.read()[1] == now_ns
    pad.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        gamepad.read()
    gamepad.close()

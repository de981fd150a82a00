"""A gamepad as a controller, through SDL, which knows the layouts of most of them.

Left stick: forward and left; right stick: up, and turns about the vertical; right trigger: deadman;
left shoulder: mode; A closes, B opens the gripper; Start is the menu button.

SDL keeps the last state of a pad whose radio is gone, and does not tell when a pad reported what it
reported before. Only of a cable is it known that it was pulled.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any

from hw.desk.desk_controller import SILENT_NS
from hw.desk.polled import PolledDevice, beyond
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic, Presses
from tams_app.units import NS_PER_MS

with warnings.catch_warnings():  # it tells at each import which library it has found
    warnings.simplefilter("ignore", UserWarning)
    import sdl2

_FULL = 32767
_TRIGGER_REST = 0.02  # a worn one does not come back to zero
_COUNTED = {  # as `Presses` has them
    sdl2.SDL_CONTROLLER_BUTTON_LEFTSHOULDER: "grip",
    sdl2.SDL_CONTROLLER_BUTTON_A: "a",
    sdl2.SDL_CONTROLLER_BUTTON_B: "b",
    sdl2.SDL_CONTROLLER_BUTTON_START: "menu",
}
# (weak motor, strong motor, duration): of 0xFFFF and [ms]
_PULSES = {
    Haptic.ENGAGE: (0x8000, 0, 60),
    Haptic.RELEASE: (0x4000, 0, 40),
    Haptic.LIMIT: (0, 0x8000, 80),
    Haptic.FAULT: (0xFFFF, 0xFFFF, 400),
    Haptic.LINK_HOLD: (0, 0x8000, 500),  # as the others, and longer
    Haptic.LINK_FAULT: (0xFFFF, 0xFFFF, 900),
}


class Gamepad(PolledDevice):
    """The first gamepad, or the first one with `DeskConfig.name` in its name."""

    title = "gamepad"

    def __init__(self, config: DeskConfig, now_ns: Callable[[], int]) -> None:
        self._config, self._now_ns = config, now_ns
        self._pad: Any = None
        self._by_radio = False
        self._unchanged_ns = round(config.unchanged_ms * NS_PER_MS)
        self._state: tuple[int, ...] = ()
        self._changed_ns = 0
        self._events = (sdl2.SDL_Event * 64)()
        self._presses = dict.fromkeys(_COUNTED.values(), 0)
        self._started = False

    def open(self) -> None:
        if not self._started:
            # SDL must take neither our signals nor our window, and see the pad without a focus
            os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
            sdl2.SDL_SetHint(sdl2.SDL_HINT_JOYSTICK_ALLOW_BACKGROUND_EVENTS, b"1")
            if sdl2.SDL_InitSubSystem(sdl2.SDL_INIT_GAMECONTROLLER) != 0:
                raise DeviceError(f"SDL finds no gamepads: {_error()}.")
            self._started = True
        sdl2.SDL_GameControllerUpdate()
        for index in range(sdl2.SDL_NumJoysticks()):
            name = _text(sdl2.SDL_JoystickNameForIndex(index))
            if sdl2.SDL_IsGameController(index) and self._config.name.lower() in name.lower():
                self._pad = sdl2.SDL_GameControllerOpen(index) or None
                if self._pad is not None:
                    self._by_radio = self._may_come_by_radio(name)
                    self._state = ()
                    sdl2.SDL_FlushEvents(sdl2.SDL_FIRSTEVENT, sdl2.SDL_LASTEVENT)
                    return
        which = f" whose name has {self._config.name!r} in it" if self._config.name else ""
        raise DeviceError(f"There is no gamepad{which}: plug one in, or choose another --hand.")

    def _may_come_by_radio(self, name: str) -> bool:
        """By SDL or, where it does not know, by the configuration; DeviceError if by neither."""
        joystick = sdl2.SDL_GameControllerGetJoystick(self._pad)
        level, declared = sdl2.SDL_JoystickCurrentPowerLevel(joystick), self._config.wireless
        if declared or level == sdl2.SDL_JOYSTICK_POWER_WIRED:
            return bool(declared)
        if level == sdl2.SDL_JOYSTICK_POWER_UNKNOWN:
            if declared is False:
                return False
            raise DeviceError(
                f"It is not known whether the gamepad {name!r} is on a cable: say so with "
                "controller.desk.wireless, false on a cable, true by radio, where what is held "
                f"without a change counts for {self._config.unchanged_ms:g} ms."
            )
        raise DeviceError(
            f"The gamepad {name!r} runs on its battery: use a cable, or set "
            "controller.desk.wireless to true; what is held without a change then counts for "
            f"{self._config.unchanged_ms:g} ms."
        )

    def read(self) -> tuple[Deflection, int]:
        sdl2.SDL_GameControllerUpdate()
        if self._pad is None or not sdl2.SDL_GameControllerGetAttached(self._pad):
            raise DeviceError("The gamepad was unplugged: plug it in again.")
        dead_zone = self._config.dead_zone
        left, forward = beyond(
            dead_zone,
            -self._axis(sdl2.SDL_CONTROLLER_AXIS_LEFTX),
            -self._axis(sdl2.SDL_CONTROLLER_AXIS_LEFTY),
        )
        turn, up = beyond(
            dead_zone,
            -self._axis(sdl2.SDL_CONTROLLER_AXIS_RIGHTX),
            -self._axis(sdl2.SDL_CONTROLLER_AXIS_RIGHTY),
        )
        trigger = self._axis(sdl2.SDL_CONTROLLER_AXIS_TRIGGERRIGHT)
        self._count_presses()
        asked = Deflection(
            linear=(forward, left, up),
            angular=(-left, forward, turn),
            trigger=trigger if trigger > _TRIGGER_REST else 0.0,
            grip=self._button(sdl2.SDL_CONTROLLER_BUTTON_LEFTSHOULDER),
            a=self._button(sdl2.SDL_CONTROLLER_BUTTON_A),
            b=self._button(sdl2.SDL_CONTROLLER_BUTTON_B),
            menu=self._button(sdl2.SDL_CONTROLLER_BUTTON_START),
            presses=Presses(**self._presses),
        )
        return asked, self._known_ns(is_held=asked.trigger > 0.0)

    def _count_presses(self) -> None:
        """By SDL's events: a button may go down and up between two readings.

        Each is taken once: one that comes meanwhile waits for the next reading.
        """
        events, joystick = self._events, sdl2.SDL_GameControllerGetJoystick(self._pad)
        number = sdl2.SDL_JoystickInstanceID(joystick)
        every = sdl2.SDL_GETEVENT, sdl2.SDL_FIRSTEVENT, sdl2.SDL_LASTEVENT
        while (found := sdl2.SDL_PeepEvents(events, len(events), *every)) > 0:
            for event in events[:found]:
                if event.type != sdl2.SDL_CONTROLLERBUTTONDOWN or event.cbutton.which != number:
                    continue
                if pressed := _COUNTED.get(event.cbutton.button):
                    self._presses[pressed] += 1

    def _known_ns(self, is_held: bool) -> int:
        """Until when the pad is known to be in this state; any change is a sign of life.

        With the deadman up a pad that has gone moves nothing.
        """
        now_ns = self._now_ns()
        axis, button = sdl2.SDL_GameControllerGetAxis, sdl2.SDL_GameControllerGetButton
        state = (
            *(axis(self._pad, number) for number in range(sdl2.SDL_CONTROLLER_AXIS_MAX)),
            *(button(self._pad, number) for number in range(sdl2.SDL_CONTROLLER_BUTTON_MAX)),
        )
        if state != self._state or not is_held or not self._by_radio:
            self._state, self._changed_ns = state, now_ns
        # as old as it must be to be stale when it has been held unchanged for so long
        return min(now_ns, self._changed_ns + self._unchanged_ns - SILENT_NS)

    def pulse(self, haptic: Haptic) -> None:
        """Nothing is felt with a gamepad that has no motors."""
        weak, strong, duration_ms = _PULSES[haptic]
        sdl2.SDL_GameControllerRumble(self._pad, strong, weak, duration_ms)

    def close(self) -> None:
        pad, self._pad = self._pad, None
        if pad is not None:
            sdl2.SDL_GameControllerClose(pad)

    def _axis(self, axis: int) -> float:
        return max(-1.0, float(sdl2.SDL_GameControllerGetAxis(self._pad, axis)) / _FULL)

    def _button(self, button: int) -> bool:
        return bool(sdl2.SDL_GameControllerGetButton(self._pad, button))


def _text(name: bytes | None) -> str:
    return "" if name is None else name.decode(errors="replace")


def _error() -> str:
    return _text(sdl2.SDL_GetError())

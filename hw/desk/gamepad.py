"""A gamepad as a controller, through SDL, which knows the layouts of most of them.

Left stick: forward and left; right stick: up, and turns about the vertical; right trigger: deadman;
left shoulder: mode; A closes, B opens the gripper; Start is the menu button.
"""

from __future__ import annotations

import os
import warnings
from typing import Any

from hw.desk.polled import PolledDevice, beyond
from hw.desk.virtual_hand import Deflection
from tams_app.config import DeskConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic

with warnings.catch_warnings():  # it tells at each import which library it has found
    warnings.simplefilter("ignore", UserWarning)
    import sdl2

_FULL = 32767
_TRIGGER_REST = 0.02  # a worn one does not come back to zero
# (weak motor, strong motor, duration): of 0xFFFF and [ms]
_PULSES = {
    Haptic.ENGAGE: (0x8000, 0, 60),
    Haptic.RELEASE: (0x4000, 0, 40),
    Haptic.LIMIT: (0, 0x8000, 80),
    Haptic.FAULT: (0xFFFF, 0xFFFF, 400),
}


class Gamepad(PolledDevice):
    """The first gamepad, or the first one with `DeskConfig.name` in its name."""

    title = "gamepad"

    def __init__(self, config: DeskConfig) -> None:
        self._config = config
        self._pad: Any = None
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
                    return
        which = f" whose name has {self._config.name!r} in it" if self._config.name else ""
        raise DeviceError(f"There is no gamepad{which}: plug one in, or choose another --hand.")

    def read(self) -> Deflection:
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
        return Deflection(
            linear=(forward, left, up),
            angular=(-left, forward, turn),
            trigger=trigger if trigger > _TRIGGER_REST else 0.0,
            grip=self._button(sdl2.SDL_CONTROLLER_BUTTON_LEFTSHOULDER),
            a=self._button(sdl2.SDL_CONTROLLER_BUTTON_A),
            b=self._button(sdl2.SDL_CONTROLLER_BUTTON_B),
            menu=self._button(sdl2.SDL_CONTROLLER_BUTTON_START),
        )

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

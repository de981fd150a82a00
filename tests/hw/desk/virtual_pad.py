"""A gamepad that SDL itself simulates: plugged in, moved and unplugged by the test."""

from __future__ import annotations

import ctypes
from typing import Any

from hw.desk.gamepad import sdl2

AXES, BUTTONS = sdl2.SDL_CONTROLLER_AXIS_MAX, sdl2.SDL_CONTROLLER_BUTTON_MAX
FULL = 32767


class VirtualPad:
    """One at a time: SDL calls each of them "Virtual Controller"."""

    def __init__(self) -> None:
        assert sdl2.SDL_InitSubSystem(sdl2.SDL_INIT_GAMECONTROLLER) == 0
        self._stick: Any = None
        self._index = -1
        self.rumbles = 0
        described = sdl2.SDL_VirtualJoystickDesc()
        described.version = sdl2.SDL_VIRTUAL_JOYSTICK_DESC_VERSION
        described.type = sdl2.SDL_JOYSTICK_TYPE_GAMECONTROLLER
        described.naxes, described.nbuttons = AXES, BUTTONS
        described.Rumble = self._rumble = type(described.Rumble)(self._rumbles)
        self._described = described

    def plug_in(self) -> None:
        """Attach it; the triggers rest."""
        self._index = sdl2.SDL_JoystickAttachVirtualEx(ctypes.byref(self._described))
        assert self._index >= 0, sdl2.SDL_GetError()
        self._stick = sdl2.SDL_JoystickOpen(self._index)
        for trigger in (
            sdl2.SDL_CONTROLLER_AXIS_TRIGGERLEFT,
            sdl2.SDL_CONTROLLER_AXIS_TRIGGERRIGHT,
        ):
            self.move(trigger, -1.0)

    @property
    def is_plugged_in(self) -> bool:
        return self._stick is not None

    def unplug(self) -> None:
        """Take it away; may be called twice."""
        if self._stick is not None:
            sdl2.SDL_JoystickClose(self._stick)
            assert sdl2.SDL_JoystickDetachVirtual(self._index) == 0, sdl2.SDL_GetError()
            self._stick = None

    def _rumbles(self, user_data: Any, low: int, high: int) -> int:
        self.rumbles += bool(low or high)
        return 0

    def move(self, axis: int, to: float) -> None:
        """-1 to 1; of a trigger -1 is released."""
        assert sdl2.SDL_JoystickSetVirtualAxis(self._stick, axis, round(to * FULL)) == 0

    def press(self, button: int, down: bool = True) -> None:
        assert sdl2.SDL_JoystickSetVirtualButton(self._stick, button, int(down)) == 0

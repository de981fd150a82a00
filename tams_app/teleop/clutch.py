"""The controller's buttons as edges: deadman and clutch, mode, gripper and menu button."""

from __future__ import annotations

import math
from typing import NamedTuple

from tams_app.presses import hysteresis
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.teleop.records import is_fresh
from tams_app.units import NS_PER_S

MENU_HOLD_NS = NS_PER_S

_NO_BUTTONS = frozenset(
    {
        ControllerStatus.DISCONNECTED,
        ControllerStatus.STANDBY,
        ControllerStatus.RUNTIME_QUIT,
        ControllerStatus.LINK_LOST,
        ControllerStatus.LINK_GAP,
        ControllerStatus.OPERATOR_AWAY,
    }
)


class Buttons(NamedTuple):
    """One tick's reading; the last six are edges and true for one tick only."""

    pressed: bool  # the trigger is held, with hysteresis, and this is known
    released: bool  # the trigger is up, and this is known
    press: bool  # pressed just now, from a known release
    toggle_mode: bool
    close_gripper: bool
    open_gripper: bool
    menu_down: bool
    menu_click: bool  # released within 1 s
    menu_hold: bool  # has been down for 1 s


class Clutch:
    """Turns samples into edges; anything that is not known reads as released.

    A press counts only after a release was seen: neither a trigger that was held when input came
    back nor a button that was down at the start does anything. A press that no sample shows, since
    it began and ended between two, counts by `ControllerSample.presses`.
    """

    def __init__(self, buttons_limit_ns: float) -> None:
        self._limit_ns = buttons_limit_ns
        self._trigger: bool | None = None  # None: not known
        self._grip, self._a, self._b = _Button(), _Button(), _Button()
        self._menu = _Menu()

    def update(self, sample: ControllerSample, now_ns: int) -> Buttons:
        """Take in the newest sample at `now_ns`."""
        fresh = is_fresh(sample.buttons_ns, now_ns, self._limit_ns)
        known = fresh and sample.status is ControllerStatus.OK
        known = known and math.isfinite(sample.trigger) and math.isfinite(sample.grip)
        was_up, presses = self._trigger is False, sample.presses
        self._trigger = hysteresis(sample.trigger, self._trigger) if known else None
        grip_was = True if self._grip.was_pressed(presses.grip) else self._grip.down
        grip = hysteresis(sample.grip, grip_was) if known else None
        toggles = self._grip.update(grip, presses.grip)
        closes = self._a.update(sample.a if known else None, presses.a) > 0
        opens = self._b.update(sample.b if known else None, presses.b) > 0
        menu_known = fresh and sample.status not in _NO_BUTTONS
        menu = sample.menu if menu_known else None
        down, click, hold = self._menu.update(menu, presses.menu, now_ns)
        return Buttons(
            pressed=self._trigger is True,
            released=self._trigger is False,
            press=was_up and self._trigger is True,
            toggle_mode=toggles % 2 == 1,
            close_gripper=closes and not opens,
            open_gripper=opens and not closes,
            menu_down=down,
            menu_click=click,
            menu_hold=hold,
        )


class _Button:
    """Presses of one button, from its level and from how often it has gone down."""

    def __init__(self) -> None:
        self.down: bool | None = None  # None: not known
        self._presses = 0

    def was_pressed(self, presses: int) -> bool:
        """Whether it has gone down since it was last known."""
        return self.down is not None and presses > self._presses

    def update(self, down: bool | None, presses: int) -> int:
        """The number of presses since the last sample; 0 if that or this one is not known."""
        was, counted = self.down, presses - self._presses
        self.down, self._presses = down, presses
        if was is None or down is None:
            return 0
        return max(counted, int(down and not was))


class _Menu:
    """Tells a click from a hold of the menu button."""

    def __init__(self) -> None:
        self._button = _Button()
        self._since_ns: int | None = None  # None: this press is void or has been reported

    def update(self, down: bool | None, presses: int, now_ns: int) -> tuple[bool, bool, bool]:
        """The edges (down, click, hold); `down` is None when it is not known."""
        pressed = self._button.update(down, presses) > 0
        since_ns = self._since_ns
        is_short = since_ns is not None and now_ns - since_ns < MENU_HOLD_NS
        if pressed:  # one that was down is so anew: its release was not seen
            self._since_ns = now_ns if down else None
            return True, is_short or not down, False
        clicked = down is False and is_short
        held = down is True and since_ns is not None and not is_short
        if down is not True or held:
            self._since_ns = None
        return False, clicked, held

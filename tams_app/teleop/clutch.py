"""The controller's buttons as edges: deadman and clutch, mode, gripper and menu button."""

from __future__ import annotations

import math
from typing import NamedTuple

from tams_app.config import ClutchConfig
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.units import NS_PER_MS, NS_PER_S

MENU_HOLD_NS = NS_PER_S
_FUTURE_NS = 50 * NS_PER_MS  # a time stamp further ahead than this is not believed

_NO_BUTTONS = frozenset(
    {
        ControllerStatus.DISCONNECTED,
        ControllerStatus.STANDBY,
        ControllerStatus.RUNTIME_QUIT,
        ControllerStatus.LINK_LOST,
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


def is_fresh(stamp_ns: int, now_ns: int, limit_ns: float) -> bool:
    """Whether a time stamp is at most `limit_ns` old and not from the future."""
    return -_FUTURE_NS <= now_ns - stamp_ns <= limit_ns


class Clutch:
    """Turns samples into edges; anything that is not known reads as released.

    A press counts only after a release was seen: neither a trigger that was held when input came
    back nor a button that was down at the start does anything.
    """

    def __init__(self, config: ClutchConfig, buttons_limit_ns: float) -> None:
        self._config = config
        self._limit_ns = buttons_limit_ns
        self._trigger: bool | None = None  # None: not known
        self._grip: bool | None = None
        self._a: bool | None = None
        self._b: bool | None = None
        self._menu = _Menu()

    def update(self, sample: ControllerSample, now_ns: int) -> Buttons:
        """Take in the newest sample at `now_ns`."""
        fresh = is_fresh(sample.buttons_ns, now_ns, self._limit_ns)
        known = fresh and sample.status is ControllerStatus.OK
        known = known and math.isfinite(sample.trigger) and math.isfinite(sample.grip)
        was_up, was_grip, was_a, was_b = self._trigger is False, self._grip, self._a, self._b
        self._trigger = self._hysteresis(sample.trigger, self._trigger) if known else None
        self._grip = self._hysteresis(sample.grip, self._grip) if known else None
        self._a = sample.a if known else None
        self._b = sample.b if known else None
        closes, opens = _edge(was_a, self._a), _edge(was_b, self._b)
        menu_known = fresh and sample.status not in _NO_BUTTONS
        down, click, hold = self._menu.update(sample.menu if menu_known else None, now_ns)
        return Buttons(
            pressed=self._trigger is True,
            released=self._trigger is False,
            press=was_up and self._trigger is True,
            toggle_mode=_edge(was_grip, self._grip),
            close_gripper=closes and not opens,
            open_gripper=opens and not closes,
            menu_down=down,
            menu_click=click,
            menu_hold=hold,
        )

    def _hysteresis(self, value: float, was: bool | None) -> bool | None:
        if value <= self._config.release_below:
            return False
        if value >= self._config.engage_above:
            return True if was is not None else None  # held since before it was known
        return was


class _Menu:
    """Tells a click from a hold of the menu button."""

    def __init__(self) -> None:
        self._down: bool | None = None
        self._since_ns: int | None = None  # None: this press is void or has been told

    def update(self, down: bool | None, now_ns: int) -> tuple[bool, bool, bool]:
        """The edges (down, click, hold); `down` is None when it is not known."""
        was, self._down = self._down, down
        pressed, clicked, held = _edge(was, down), False, False
        if pressed:
            self._since_ns = now_ns
        elif self._since_ns is not None:
            long_enough = now_ns - self._since_ns >= MENU_HOLD_NS
            clicked = down is False and not long_enough
            held = down is True and long_enough
            if down is not True or held:
                self._since_ns = None
        return pressed, clicked, held


def _edge(was: bool | None, now: bool | None) -> bool:
    return was is False and now is True

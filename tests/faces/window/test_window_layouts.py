"""The real window under layouts and options of XKB by which a release has another name."""

from __future__ import annotations

import time
from itertools import pairwise, permutations, product

import pytest

from tams_app.faces.commands import Command
from tams_app.faces.messages import Keys
from tests.faces.window.conftest import ShownWindow
from tests.faces.window.xvfb import wait_for
from tests.further import further

# a window that does not paint for 150 ms lets go of all keys
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=100)]

LEFT_SHIFT, RIGHT_SHIFT, LEFT_ALT, ALT_GR, W, SPACE = "50", "62", "64", "108", "25", "65"
OPTIONS = {
    "us": ("us",),
    "us,ru grp:shifts_toggle": ("us,ru", "grp:shifts_toggle"),
    "us,ru grp:alt_shift_toggle": ("us,ru", "grp:alt_shift_toggle"),
    "us,ru grp:lalt_lshift_toggle": ("us,ru", "grp:lalt_lshift_toggle"),
    "us shift:both_capslock": ("us", "shift:both_capslock"),
    "de lv3:ralt_switch": ("de", "lv3:ralt_switch"),
    "ru": ("ru",),
}
FEW = ("us", "us,ru grp:alt_shift_toggle", "de lv3:ralt_switch")
LAYOUTS = [*FEW, *further(*(name for name in OPTIONS if name not in FEW))]
HELD_AFTER_S = 0.3  # beats: fifteen


def held(window: ShownWindow) -> tuple[str, ...] | None:
    """What the application was told last; None without the focus."""
    keys = window.client.keys
    return keys.held if keys is not None and keys.focused else None


def becomes(window: ShownWindow, *names: str) -> bool:
    return wait_for(lambda: held(window) == names, 20.0)


def stays(window: ShownWindow, *names: str) -> bool:
    """Whether the application is told so at first and after several beats."""
    if not becomes(window, *names):
        return False
    time.sleep(HELD_AFTER_S)
    return held(window) == names


@pytest.fixture
def shown(window: ShownWindow) -> ShownWindow:
    """With the focus for long enough, and nothing pressed."""
    window.screen.xdotool("key", "F2")  # the X server takes over the keyboard that XTEST has
    assert becomes(window)
    window.until_presses_count()
    return window


def set_layout(window: ShownWindow, name: str) -> None:
    window.screen.layout(*OPTIONS[name])
    time.sleep(0.5)  # the toolkit takes in the new map


@pytest.mark.parametrize("name", LAYOUTS)
def test_shift_is_held_while_it_is_down_and_never_longer(shown: ShownWindow, name: str) -> None:
    set_layout(shown, name)
    for _ in range(2):
        shown.screen.xdotool("keydown", LEFT_SHIFT)
        assert stays(shown, "Shift_L")
        shown.screen.xdotool("keyup", LEFT_SHIFT)
        assert stays(shown)


@pytest.mark.parametrize("name", LAYOUTS)
def test_shift_and_alt_together_leave_nothing_held(shown: ShownWindow, name: str) -> None:
    set_layout(shown, name)
    keys = (LEFT_SHIFT, LEFT_ALT)
    for downs, ups in product(permutations(keys), permutations(keys)):
        for code in downs:
            shown.screen.xdotool("keydown", code)
        for code in ups:
            shown.screen.xdotool("keyup", code)
        assert stays(shown)


@pytest.mark.parametrize("name", LAYOUTS)
def test_two_shifts_leave_nothing_held(shown: ShownWindow, name: str) -> None:
    set_layout(shown, name)
    shown.screen.xdotool("keydown", LEFT_SHIFT, "keydown", RIGHT_SHIFT)
    time.sleep(0.1)
    shown.screen.xdotool("keyup", LEFT_SHIFT)
    time.sleep(0.1)
    shown.screen.xdotool("keyup", RIGHT_SHIFT)
    assert stays(shown)


@pytest.mark.parametrize("name", LAYOUTS)
def test_w_is_w_in_every_layout_also_with_alt_gr(shown: ShownWindow, name: str) -> None:
    set_layout(shown, name)
    shown.screen.xdotool("keydown", W)
    assert stays(shown, "w")
    shown.screen.xdotool("keyup", W)
    assert stays(shown)
    shown.screen.xdotool("keydown", ALT_GR, "keydown", W)
    assert wait_for(lambda: "w" in (held(shown) or ()), 20.0)
    shown.screen.xdotool("keyup", ALT_GR, "keyup", W)
    assert stays(shown)


def test_a_layout_that_is_switched_while_keys_are_held_leaves_none_held(
    shown: ShownWindow,
) -> None:
    set_layout(shown, "us")
    shown.screen.xdotool("keydown", W, "keydown", LEFT_SHIFT)
    assert becomes(shown, "w", "Shift_L")
    set_layout(shown, "ru")
    shown.screen.xdotool("keyup", W)
    assert wait_for(lambda: "w" not in (held(shown) or ()), 20.0)
    shown.screen.xdotool("keyup", LEFT_SHIFT)
    assert stays(shown)


def test_what_goes_up_while_another_client_has_the_keys_is_not_held(shown: ShownWindow) -> None:
    set_layout(shown, "us")
    shown.screen.xdotool("keydown", LEFT_SHIFT, "keydown", W)
    assert becomes(shown, "Shift_L", "w")
    with shown.screen.keyboard_grabbed():
        assert wait_for(lambda: held(shown) is None, 20.0)
        shown.screen.xdotool("keyup", LEFT_SHIFT, "keyup", W)
    assert stays(shown)


def test_keys_that_are_down_when_the_focus_comes_do_not_count_until_they_were_up(
    shown: ShownWindow,
) -> None:
    set_layout(shown, "us")
    with shown.screen.keyboard_grabbed():
        assert wait_for(lambda: held(shown) is None, 20.0)
        shown.screen.xdotool("keydown", LEFT_SHIFT, "keydown", W)
    assert stays(shown)
    time.sleep(1.0)  # w repeats itself
    assert held(shown) == ()
    shown.screen.xdotool("keyup", LEFT_SHIFT, "keyup", W)
    time.sleep(1.0)
    shown.screen.xdotool("keydown", LEFT_SHIFT, "keydown", W)
    assert stays(shown, "Shift_L", "w")
    shown.screen.xdotool("keyup", LEFT_SHIFT, "keyup", W)
    assert stays(shown)


@pytest.mark.parametrize("name", LAYOUTS)
def test_space_stops_with_every_modifier_in_every_layout(shown: ShownWindow, name: str) -> None:
    set_layout(shown, name)
    shown.events.clear()
    shown.screen.xdotool("key", SPACE)
    for modifier in (LEFT_SHIFT, ALT_GR):
        shown.screen.xdotool("keydown", modifier, "key", SPACE, "keyup", modifier)
    assert wait_for(lambda: len(shown.commands()) == 3, 20.0)
    assert set(shown.commands()) == {Command.EMERGENCY_STOP}
    assert stays(shown)


def test_a_deadman_is_told_in_the_same_moment_as_it_goes_down_and_up(shown: ShownWindow) -> None:
    """Not with the next beat only: the modifiers follow the key."""
    set_layout(shown, "us")
    shown.events.clear()
    for _ in range(20):
        shown.screen.xdotool("keydown", LEFT_SHIFT, "keyup", LEFT_SHIFT)
    assert stays(shown)
    told = [event.held for event in shown.events if isinstance(event, Keys)]
    presses = sum(now == ("Shift_L",) and before == () for before, now in pairwise(told))
    assert presses >= 15

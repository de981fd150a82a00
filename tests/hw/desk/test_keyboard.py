"""What the held keys ask for, and what the window's silence means."""

from __future__ import annotations

from itertools import combinations

import pytest

from hw.desk.keyboard import KEYS, HeldKeys, KeyboardController, deflection_of
from tams_app.config import DeskConfig, HandConfig
from tams_app.records import ControllerStatus
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed


def held(*keys: str, focused: bool = True, t_ns: int = NS_PER_S) -> HeldKeys:
    return HeldKeys(frozenset(keys), focused, t_ns)


@pytest.fixture
def keyboard() -> KeyboardController:
    made = KeyboardController(DeskConfig(), HandConfig().rotation)
    made.start()
    return made


def test_each_key_asks_for_something_of_its_own() -> None:
    asked = [deflection_of(frozenset({key})) for key in sorted(KEYS)]
    assert all(one != another for one, another in combinations(asked, 2))
    assert all(one != deflection_of(frozenset()) for one in asked)


@pytest.mark.parametrize("pair", ["ws", "ad", "rf"])
def test_opposite_keys_cancel_each_other(pair: str) -> None:
    assert deflection_of(frozenset(pair)) == deflection_of(frozenset())


def test_keys_that_mean_nothing_ask_for_nothing() -> None:
    assert deflection_of(frozenset({"x", "F1", ""})) == deflection_of(frozenset())


def test_before_the_window_has_told_anything_the_controller_is_laid_down(
    keyboard: KeyboardController,
) -> None:
    sample = keyboard.sample(NS_PER_S)
    assert (sample.status, sample.trigger, sample.pose) == (ControllerStatus.STANDBY, 0.0, None)


def test_a_window_without_focus_is_a_controller_that_is_laid_down(
    keyboard: KeyboardController,
) -> None:
    keyboard.feed(held("shift", "w"))
    assert keyboard.sample(NS_PER_S).trigger == 1.0
    keyboard.feed(held("shift", "w", focused=False, t_ns=NS_PER_S + 1))
    sample = keyboard.sample(NS_PER_S + 1)
    assert (sample.status, sample.trigger, sample.pose) == (ControllerStatus.STANDBY, 0.0, None)


def test_a_window_that_tells_nothing_any_more_lets_pose_and_buttons_grow_old(
    keyboard: KeyboardController,
) -> None:
    """The safety logic then stops the arm, as with any controller that freezes."""
    keyboard.feed(held("shift", "w"))
    keyboard.sample(NS_PER_S)
    for late_ms in range(8, 500, 8):
        last = keyboard.sample(NS_PER_S + late_ms * NS_PER_MS)
    assert last.buttons_ns == NS_PER_S + 100 * NS_PER_MS  # so late it may be
    assert last.pose_ns <= NS_PER_S + 200 * NS_PER_MS


def test_a_hand_that_rests_is_no_frozen_pose(keyboard: KeyboardController) -> None:
    for number in range(100):
        now_ns = NS_PER_S + number * 8 * NS_PER_MS
        keyboard.feed(held("shift", t_ns=now_ns))
        assert keyboard.sample(now_ns).pose_ns == now_ns

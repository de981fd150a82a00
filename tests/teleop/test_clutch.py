from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.presses import PressCounter
from tams_app.records import ControllerSample, ControllerStatus, Pose, Presses
from tams_app.rotation import Rotation
from tams_app.teleop.clutch import MENU_HOLD_NS, Buttons, Clutch
from tams_app.teleop.records import is_fresh
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.waiting

IDLE = ControllerSample.released(ControllerStatus.OK, Pose(np.zeros(3), Rotation.identity()), 0, 0)


class Finger:
    def __init__(self) -> None:
        self.clutch = Clutch(100 * NS_PER_MS)
        self.now_ns = 0

    def read(self, after_ms: float = 8, age_ms: float = 0, **sample: object) -> Buttons:
        self.now_ns += round(after_ms * NS_PER_MS)
        stamp = self.now_ns - round(age_ms * NS_PER_MS)
        return self.clutch.update(replace(IDLE, buttons_ns=stamp, **sample), self.now_ns)


@pytest.fixture
def finger() -> Finger:
    finger = Finger()
    finger.read()
    return finger


def test_the_trigger_engages_at_its_upper_and_releases_at_its_lower_threshold(
    finger: Finger,
) -> None:
    levels = [0.59, 0.6, 0.5, 0.41, 0.4, 0.5, 0.59, 0.61]
    assert [finger.read(trigger=level).pressed for level in levels] == [
        False, True, True, True, False, False, False, True,
    ]  # fmt: skip


def test_a_press_is_an_edge(finger: Finger) -> None:
    assert [finger.read(trigger=t).press for t in (0.0, 1.0, 1.0, 0.0, 1.0)] == [
        False, True, False, False, True,
    ]  # fmt: skip


def test_a_trigger_held_at_the_start_does_nothing_until_it_was_up() -> None:
    finger = Finger()
    held = finger.read(trigger=1.0)
    assert not any((held.pressed, held.press, held.released))
    assert finger.read(trigger=0.0).released
    assert finger.read(trigger=1.0).press


@pytest.mark.parametrize(
    "away",
    [
        *({"status": status} for status in ControllerStatus if status is not ControllerStatus.OK),
        {"age_ms": 101},
        {"trigger": float("nan")},
        {"grip": float("inf")},
    ],
)
def test_unknown_input_reads_as_released_and_needs_a_fresh_release(
    finger: Finger, away: dict[str, object]
) -> None:
    assert finger.read(trigger=1.0).pressed
    gone = finger.read(**{"trigger": 1.0, "a": True, "grip": 1.0, **away})
    assert not any((gone.pressed, gone.released, gone.close_gripper, gone.toggle_mode))
    back = finger.read(trigger=1.0, a=True, grip=1.0)
    assert not any((back.pressed, back.press, back.close_gripper, back.toggle_mode))
    assert finger.read(trigger=0.5).pressed is False
    assert not finger.read(trigger=1.0).press  # 0.5 is not yet up
    assert finger.read(trigger=0.0).released
    assert finger.read(trigger=1.0).press


@pytest.mark.parametrize("button", ["a", "b"])
def test_a_button_pressed_while_nothing_was_known_moves_no_gripper(
    finger: Finger, button: str
) -> None:
    for reading in (finger.read(**{button: True, "age_ms": 500}), finger.read(**{button: True})):
        assert not any((reading.close_gripper, reading.open_gripper))


def test_a_closes_and_b_opens_on_their_edges(finger: Finger) -> None:
    assert finger.read(a=True).close_gripper
    assert not finger.read(a=True).close_gripper
    assert finger.read(b=True).open_gripper
    finger.read()
    both = finger.read(a=True, b=True)
    assert not any((both.close_gripper, both.open_gripper))


def test_grip_toggles_on_its_edge_with_hysteresis(finger: Finger) -> None:
    assert [finger.read(grip=g).toggle_mode for g in (1.0, 0.5, 0.7, 0.3, 0.7)] == [
        True, False, False, False, True,
    ]  # fmt: skip


def test_the_menu_clicked_is_not_held_and_held_is_not_clicked(finger: Finger) -> None:
    assert finger.read(menu=True).menu_down
    assert finger.read(after_ms=900, menu=False).menu_click
    finger.read(menu=True)
    assert not finger.read(after_ms=999, menu=True).menu_hold
    assert finger.read(after_ms=1, menu=True).menu_hold
    assert not finger.read(after_ms=2000, menu=True).menu_hold
    after = finger.read(menu=False)
    assert not any((after.menu_click, after.menu_hold))
    assert MENU_HOLD_NS == NS_PER_S


def test_the_menu_is_void_when_it_was_down_at_the_start_or_input_was_lost(finger: Finger) -> None:
    start = Finger()
    start.read(menu=True)
    assert not start.read(after_ms=2000, menu=True).menu_hold
    assert not start.read(menu=False).menu_click
    finger.read(menu=True)
    finger.read(menu=True, age_ms=500)
    assert not finger.read(after_ms=1200, menu=True).menu_hold
    assert not finger.read(menu=False).menu_click


def test_the_menu_works_while_tracking_is_lost(finger: Finger) -> None:
    assert finger.read(menu=True, status=ControllerStatus.TRACKING_LOST).menu_down
    assert finger.read(menu=False, status=ControllerStatus.TRACKING_LOST).menu_click


@pytest.mark.parametrize(
    "gone", [ControllerStatus.DISCONNECTED, ControllerStatus.STANDBY, ControllerStatus.RUNTIME_QUIT]
)
def test_the_menu_of_a_controller_that_is_gone_is_not_believed(
    finger: Finger, gone: ControllerStatus
) -> None:
    assert not finger.read(menu=True, status=gone).menu_down
    assert not finger.read(menu=False, status=gone).menu_click


@pytest.mark.parametrize(
    ("button", "edge"),
    [("grip", "toggle_mode"), ("a", "close_gripper"), ("b", "open_gripper")],
)
def test_a_press_that_no_sample_shows_is_an_edge_once(
    finger: Finger, button: str, edge: str
) -> None:
    for number in (1, 2):
        tapped = Presses(**{button: number})
        readings = [finger.read(presses=tapped), finger.read(presses=tapped)]
        assert [getattr(reading, edge) for reading in readings] == [True, False]
    held = [finger.read(**{button: True, "presses": Presses(**{button: 3})}) for _ in range(3)]
    assert [getattr(reading, edge) for reading in held] == [True, False, False]
    again = finger.read(**{button: True, "presses": Presses(**{button: 4})})
    assert getattr(again, edge)  # it went up and down between two samples


@pytest.mark.parametrize("pressed", range(7))
def test_the_mode_changes_by_an_odd_number_of_presses_of_the_grip_between_two_samples(
    finger: Finger, pressed: int
) -> None:
    assert finger.read(presses=Presses(grip=pressed)).toggle_mode == (pressed in (1, 3, 5))
    assert finger.read(presses=Presses(grip=pressed + 1)).toggle_mode


@pytest.mark.parametrize(
    "away", [{"status": ControllerStatus.STANDBY}, {"age_ms": 101}, {"trigger": float("nan")}]
)
def test_what_was_pressed_while_input_was_not_known_does_nothing(
    finger: Finger, away: dict[str, object]
) -> None:
    finger.read(**away)
    pressed = Presses(grip=1, a=1, b=1)
    for reading in (finger.read(**{**away, "presses": pressed}), finger.read(presses=pressed)):
        assert not any((reading.toggle_mode, reading.close_gripper, reading.open_gripper))
    at_first = Finger()
    assert not at_first.read(presses=Presses(a=7)).close_gripper


def test_a_click_of_the_menu_that_no_sample_shows_is_one(finger: Finger) -> None:
    tapped = finger.read(presses=Presses(menu=1))
    assert (tapped.menu_down, tapped.menu_click, tapped.menu_hold) == (True, True, False)
    for after_ms in (8, 2000):
        assert not any(finger.read(after_ms=after_ms, presses=Presses(menu=1))[-3:])


def test_the_menu_pressed_anew_between_two_samples_was_clicked_and_is_not_held_the_longer(
    finger: Finger,
) -> None:
    assert finger.read(menu=True, presses=Presses(menu=1)).menu_down
    anew = finger.read(after_ms=600, menu=True, presses=Presses(menu=2))
    assert (anew.menu_down, anew.menu_click) == (True, True)
    assert not finger.read(after_ms=600, menu=True, presses=Presses(menu=2)).menu_hold
    assert finger.read(after_ms=400, menu=True, presses=Presses(menu=2)).menu_hold


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.booleans()), min_size=1, max_size=200))
def test_whoever_samples_seldom_sees_each_press_that_whoever_samples_always_sees(
    readings: list[tuple[float, bool, bool]],
) -> None:
    counter, always, seldom = PressCounter(), Finger(), Finger()
    start = counter.update(0.0, False, False, False)
    always.read(presses=start)
    seldom.read(presses=start)
    toggles = [0, 0]
    closed = [0, 0]
    for number, (grip, a, sampled) in enumerate(readings):
        presses = counter.update(grip, a, False, False)
        sample = {"grip": grip, "a": a, "presses": presses}
        for place, finger in enumerate((always, seldom)):
            if place == 0 or sampled or number == len(readings) - 1:
                reading = finger.read(**sample)
                toggles[place] += reading.toggle_mode
                closed[place] += reading.close_gripper
    assert toggles[0] == presses.grip
    assert toggles[1] % 2 == presses.grip % 2
    assert closed[0] == presses.a
    assert bool(closed[1]) == bool(presses.a)


def test_a_stamp_far_in_the_future_is_not_fresh() -> None:
    assert is_fresh(10, 10, 0)
    assert is_fresh(10 + 50 * NS_PER_MS, 10, 0)
    assert not is_fresh(11 + 50 * NS_PER_MS, 10, 0)

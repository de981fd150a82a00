"""Which component was pressed, and what is said when none, two or the wrong one came."""

import pytest

from calibration.frame.buttons import TIMEOUT_NS, PressWatch, settle
from calibration.frame.fit import BeginAgainError, RefusedError
from hw.openvr.components import ComponentReading

pytestmark = pytest.mark.untimed

FOCUS = "vive_focus3_controller"
USUAL = {
    "trigger": "trigger/pull",
    "grip": "grip/pull",
    "a": "a/click",
    "b": "b/click",
    "menu": "joystick/click",
}


def reading(**pressed):
    values = dict.fromkeys(USUAL.values(), 0.0)
    values |= {USUAL[role]: value for role, value in pressed.items()}
    return ComponentReading(FOCUS, values)


def play(watch, *readings):
    found = None
    for number, one in enumerate(readings):
        assert found is None
        found = watch.take(one, number)
    return found


def test_a_component_counts_when_it_is_let_go():
    watch = PressWatch("a", {})
    assert play(watch, reading(), reading(b=1.0), reading(b=1.0)) is None
    assert watch.take(reading(), 9) == "b/click"


def test_what_is_held_at_the_beginning_does_not_count():
    watch = PressWatch("a", {})
    assert play(watch, reading(trigger=1.0), reading(trigger=0.0)) is None
    assert play(watch, reading(a=1.0), reading()) == "a/click"


def test_two_at_once_and_one_that_plays_another_part_already_are_refused_by_name():
    for taken, pressed, refused, words in (
        ({}, {"a": 1.0, "b": 1.0}, RefusedError, "a/click and b/click were .* the b alone"),
        ({"a/click": "a"}, {"a": 1.0}, BeginAgainError, "a/click is the a already"),
    ):
        with pytest.raises(refused, match=words):
            play(PressWatch("b", taken), reading(), reading(**pressed), reading())


@pytest.mark.parametrize(
    ("steady", "words"),
    [
        (reading(), "nothing arrived: wake the controller"),
        (reading(grip=0.9), "grip/pull never came free"),
        (None, "the controller is switched off, or SteamVR's dashboard is open"),
    ],
)
def test_a_missing_press_is_told_with_why(steady, words):
    watch = PressWatch("menu", {})
    watch.take(steady, 0)
    assert watch.take(steady, TIMEOUT_NS) is None
    with pytest.raises(RefusedError, match=f"menu: {words}"):
        watch.take(steady, TIMEOUT_NS + 1)


def test_a_button_cannot_be_the_deadman():
    found = USUAL | {"trigger": "a/click", "a": "joystick/click", "menu": "b/click"}
    found["b"] = "trigger/pull"
    with pytest.raises(BeginAgainError, match=r"the deadman must be analog|is analog"):
        settle(FOCUS, "right", found, USUAL)

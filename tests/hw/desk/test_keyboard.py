"""What the held keys ask for, and what the window's silence means."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hw.desk.keyboard import DEADMAN, KEYS, Deflection, HeldKeys, KeyboardController, deflection_of
from tams_app.config import DeskConfig, HandConfig
from tams_app.records import ControllerSample, ControllerStatus, Presses
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import Floats3, floats

pytestmark = pytest.mark.untimed


def held(*keys: str, focused: bool = True, t_ns: int = NS_PER_S) -> HeldKeys:
    return HeldKeys(frozenset(keys), focused, t_ns)


def asked(*keys: str) -> Deflection:
    return deflection_of(frozenset(keys), {}, dict.fromkeys(set(keys) & set("wsadrf"), 1.0))


@pytest.fixture
def keyboard() -> KeyboardController:
    made = KeyboardController(DeskConfig(), HandConfig().rotation)
    made.start()
    return made


def test_each_key_asks_for_something_of_its_own() -> None:
    found = [asked(key) for key in sorted(KEYS)]
    assert all(one != another for one, another in combinations(found, 2))
    assert all(one != asked() for one in found)


@pytest.mark.parametrize(
    ("key", "linear", "angular"),
    [
        ("w", (1, 0, 0), (0, 1, 0)),  # forward, or tilted over forward
        ("s", (-1, 0, 0), (0, -1, 0)),
        ("a", (0, 1, 0), (-1, 0, 0)),  # to the left
        ("d", (0, -1, 0), (1, 0, 0)),
        ("r", (0, 0, 1), (0, 0, 1)),  # up, or turned to the left
        ("f", (0, 0, -1), (0, 0, -1)),
    ],
)
def test_each_key_moves_the_hand_its_own_way(key: str, linear: Floats3, angular: Floats3) -> None:
    assert asked(key) == Deflection(linear, angular)


def test_only_shift_is_the_deadman_and_a_key_that_was_never_pressed_has_no_presses() -> None:
    assert [key for key in sorted(KEYS) if asked(key).trigger] == [DEADMAN]
    assert asked(*KEYS).presses == Presses()


@pytest.mark.parametrize("pair", ["ws", "ad", "rf"])
def test_opposite_keys_cancel_each_other(pair: str) -> None:
    assert asked(*pair) == asked()


def test_keys_that_mean_nothing_ask_for_nothing() -> None:
    assert asked("x", "F1", "") == asked()


def test_keys_that_were_held_before_the_end_are_not_held_after_the_next_start(
    keyboard: KeyboardController,
) -> None:
    keyboard.feed(held("shift", "w"))
    assert keyboard.sample(NS_PER_S).trigger == 1.0
    keyboard.close()
    assert keyboard.sample(NS_PER_S).status is ControllerStatus.DISCONNECTED
    keyboard.start()
    sample = keyboard.sample(NS_PER_S)
    assert (sample.status, sample.trigger) == (ControllerStatus.STANDBY, 0.0)
    assert (sample.pose_ns, sample.buttons_ns) == (0, 0)


def test_a_window_without_focus_is_laid_down_and_with_it_again_a_hand_that_rests(
    keyboard: KeyboardController,
) -> None:
    for t_ns in range(NS_PER_S, 2 * NS_PER_S, 8 * NS_PER_MS):
        keyboard.feed(held("shift", "w", "m", "c", "o", t_ns=t_ns))
        before = keyboard.sample(t_ns)
    assert (before.trigger, before.grip, before.a, before.b) == (1.0, 1.0, True, True)
    assert before.pose is not None
    assert before.pose.position.any()
    keyboard.feed(held("shift", "w", "m", "c", "o", focused=False, t_ns=t_ns + 1))
    assert keyboard.sample(t_ns + 1) == ControllerSample.released(
        ControllerStatus.STANDBY, None, t_ns, t_ns
    )
    keyboard.feed(held("shift", "w", t_ns=t_ns + 2))
    again = keyboard.sample(t_ns + 2)
    assert again.pose is not None
    assert not again.pose.position.any()


def test_a_silent_window_moves_the_hand_for_as_long_as_it_may_be_late_and_not_a_moment_longer(
    keyboard: KeyboardController,
) -> None:
    """The safety logic then stops the arm, as with any controller that freezes."""
    keyboard.feed(held("shift", "w"))
    limit_ns = NS_PER_S + 200 * NS_PER_MS
    for now_ns in (*range(NS_PER_S, limit_ns, 8 * NS_PER_MS), limit_ns):
        last = keyboard.sample(now_ns)
        assert last.pose_ns == now_ns
        assert last.buttons_ns == min(now_ns, NS_PER_S + 100 * NS_PER_MS)
    for now_ns in (limit_ns + 1, limit_ns + 8 * NS_PER_MS, limit_ns + NS_PER_S):
        assert keyboard.sample(now_ns) == last


def test_a_key_that_was_down_for_less_than_a_sample_has_been_pressed(
    keyboard: KeyboardController,
) -> None:
    keyboard.feed(HeldKeys(frozenset(), True, NS_PER_S, {"m": 1, "c": 2, "o": 3, "w": 4}))
    sample = keyboard.sample(NS_PER_S)
    assert sample.presses == Presses(grip=1, a=2, b=3)
    assert not any((sample.grip, sample.a, sample.b))


def moved_mm(
    keyboard: KeyboardController, taps_ms: list[tuple[int, int]], looks_ms: int, first_ms: int
) -> float:
    """The way of the hand until long after the taps (down, up), read once in `looks_ms`."""
    beginning, way = None, 0.0
    for now_ms in range(0, 4000, 8):
        read_ms = (now_ms - first_ms) // looks_ms * looks_ms + first_ms
        keys = {DEADMAN} | {"a" for down, up in taps_ms if down <= read_ms < up}
        presses = {"a": sum(down <= read_ms for down, _ in taps_ms)}
        t_ns = NS_PER_S + now_ms * NS_PER_MS
        keyboard.feed(HeldKeys(frozenset(keys), True, t_ns, presses))
        pose = keyboard.sample(t_ns).pose
        assert pose is not None
        beginning = pose.position if beginning is None else beginning
        way = 1000 * float(np.linalg.norm(pose.position - beginning))
    return way


@pytest.mark.parametrize("first_ms", [0, 37, 90])
@pytest.mark.parametrize("looks_ms", [8, 40, 100, 150])
@pytest.mark.parametrize("tap_ms", [2, 12, 20, 50, 100])
def test_each_tap_moves_a_millimetre_or_two_however_rarely_keys_are_read(
    tap_ms: int, looks_ms: int, first_ms: int, keyboard: KeyboardController
) -> None:
    taps = [(500 * n, 500 * n + tap_ms) for n in range(1, 4)]
    assert 3.0 <= moved_mm(keyboard, taps, looks_ms, first_ms) <= 6.0


def test_a_key_that_stays_down_moves_the_hand_at_full_speed(keyboard: KeyboardController) -> None:
    way_mm = moved_mm(keyboard, [(500, 2500)], 20, 0)
    assert way_mm == pytest.approx(1000 * DeskConfig().speed_m_s * 1.75, rel=0.05)


def test_without_the_deadman_a_tap_is_none_and_a_step_ends_at_once(
    keyboard: KeyboardController,
) -> None:
    def feed(now_ms: int, *keys: str, presses: int) -> Floats3:
        t_ns = NS_PER_S + now_ms * NS_PER_MS
        keyboard.feed(HeldKeys(frozenset(keys), True, t_ns, {"a": presses}))
        pose = keyboard.sample(t_ns).pose
        assert pose is not None
        return floats(pose.position)

    at_rest = feed(0, "a", presses=1)
    assert feed(8, DEADMAN, presses=1) == feed(16, DEADMAN, presses=1) == at_rest
    feed(24, DEADMAN, presses=2)
    moving = feed(32, DEADMAN, presses=2)
    assert moving != at_rest
    assert feed(40, presses=2) == feed(48, presses=2) == moving
    assert feed(56, DEADMAN, presses=2) == feed(64, DEADMAN, presses=2) == moving

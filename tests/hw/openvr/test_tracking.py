import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hw.openvr.tracking import QUIET_NS, RELEASED_FOR_NS, UNREAD_AFTER_NS, Announcer, HandKeeper
from tams_app.records import ControllerStatus
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed


STEP = st.tuples(
    st.sampled_from("ABC"),
    st.none() | st.floats(0, 1) | st.just(math.nan),
    st.integers(1, 600).map(lambda ms: ms * NS_PER_MS),
)


@given(st.lists(STEP, max_size=60))
@example([("A", 0.0, 1), ("B", math.nan, NS_PER_S), ("B", math.nan, 2 * NS_PER_S)])
@example([("A", 0.0, 1), ("B", 0.0, NS_PER_S), ("C", 0.0, NS_PER_S)])
def test_no_other_device_becomes_the_hand_without_a_second_of_open_trigger(steps):
    hand, mine, now_ns = HandKeeper(), None, 0
    history: list[tuple[int, str, float | None]] = []
    for serial, trigger, wait_ns in steps:
        now_ns += wait_ns
        history.append((now_ns, serial, trigger))
        swapped = hand.is_swapped(serial, trigger, now_ns)
        if mine is None or serial == mine:  # the first one, whatever its trigger does
            assert not swapped
        elif not swapped:
            open_since_ns = now_ns
            for at_ns, who, pulled in reversed(history):
                if who != serial or pulled is None or not pulled <= 0.2:
                    break
                open_since_ns = at_ns
            assert now_ns - open_since_ns >= RELEASED_FOR_NS
        mine = mine if swapped else serial


@pytest.fixture
def notes():
    return []


@pytest.fixture
def announcer(notes):
    return Announcer(lambda level, text: notes.append((level, text)))


def test_flicker_is_told_as_it_ends_up(announcer, notes):
    announcer.notify(ControllerStatus.OK, "", 0)
    for now_ns in range(1, QUIET_NS, QUIET_NS // 20):
        announcer.notify(ControllerStatus.TRACKING_LOST, "no pose", now_ns)
        announcer.notify(ControllerStatus.OK, "", now_ns)
    announcer.notify(ControllerStatus.STANDBY, "", QUIET_NS)
    assert [text for _, text in notes] == ["controller: ok", "controller: standby"]


def test_why_the_runtime_is_away_is_told_once_for_each_absence(announcer, notes):
    for sentence in ("not running", "not running", "no headset"):
        announcer.notify_failure(sentence)
    announcer.forget_failure()
    announcer.notify_failure("no headset")
    assert [text for _, text in notes] == ["not running", "no headset", "no headset"]


def test_unread_actions_are_told_only_if_they_stay_unread(announcer, notes):
    announcer.notify_unread(("menu",), 0)
    announcer.notify_unread((), UNREAD_AFTER_NS - 1)
    announcer.notify_unread(("menu",), UNREAD_AFTER_NS)
    assert notes == []
    announcer.notify_unread(("menu",), 2 * UNREAD_AFTER_NS)
    announcer.notify_unread(("menu",), 3 * UNREAD_AFTER_NS)
    assert len(notes) == 1
    assert "menu" in notes[0][1]

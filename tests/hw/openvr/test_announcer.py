import pytest

from hw.openvr.tracking import QUIET_NS, UNREAD_AFTER_NS, Announcer
from tams_app.records import ControllerStatus

pytestmark = pytest.mark.untimed


@pytest.fixture
def notes():
    return []


@pytest.fixture
def announcer(notes):
    return Announcer(lambda level, text: notes.append((level, text)))


def test_a_change_is_told_once(announcer, notes):
    for now_ns in range(5):
        announcer.notify(ControllerStatus.OK, "", now_ns)
    for n in range(5):
        announcer.notify(ControllerStatus.TRACKING_LOST, "out of range", QUIET_NS + n)
    assert notes == [
        ("info", "controller: ok"),
        ("warning", "controller: tracking lost, out of range"),
    ]


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

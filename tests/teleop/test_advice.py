"""What to do about a stop, from the words that tell it."""

import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.teleop.hands import HANDS, hand_of, words_of, words_of_hand
from tams_app.teleop.reasons import Reason, advice, refusal, what_to_do

pytestmark = pytest.mark.untimed

OPENVR, KEYBOARD = HANDS["openvr"], HANDS["keyboard"]


@pytest.mark.parametrize("hand", HANDS.values(), ids=HANDS)
@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_a_sentence_while_it_lasts_and_one_once_it_is_gone(reason, hand):
    for told in (reason.label, f"{reason.label}: eih, 1.2 s old"):
        assert what_to_do(told, reason.label, hand) == reason.sentence(hand)
        assert what_to_do(told, "", hand) == reason.sentence(hand, lasts=False)


def test_a_log_that_does_not_tell_what_lasts_has_the_whole_sentence():
    assert what_to_do("stale video", None, OPENVR) == Reason.STALE_VIDEO.sentence(OPENVR)


def test_another_cause_that_is_still_there_comes_before_what_is_left():
    told = "emergency stop: and guard blind"
    assert what_to_do(told, "guard blind", OPENVR) == Reason.GUARD_BLIND.sentence(OPENVR)


def test_words_that_are_no_reason_have_no_advice():
    assert what_to_do("", "", OPENVR) == ""
    assert what_to_do("something else: entirely", "", OPENVR) == ""


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("emergency stop", f"emergency stop. {Reason.EMERGENCY_STOP.sentence(OPENVR)}"),
        (
            "arm refuses: Free the joint.",
            "arm refuses: Free the joint. Release the trigger, then confirm.",
        ),
        ("arm refuses: Free it, then confirm.", "arm refuses: Free it, then confirm."),
    ],
)
def test_what_happened_is_told_with_what_to_do(told, said):
    assert advice(told, told.partition(":")[0], OPENVR) == said


def test_what_happened_is_told_with_what_is_left_to_do_once_its_cause_is_gone():
    assert advice("stale video", "", KEYBOARD) == "stale video. The video is back: release Shift."


PARTS = ["deadman", "device", "release", "wake", "connect", "check", "confirm"]


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("hand", HANDS.values(), ids=HANDS)
def test_a_sentence_is_told_in_the_words_of_the_hand(part, hand):
    words = getattr(hand, part)
    assert hand.fill(f"Then {{{part}}}.") == f"Then {words}."
    begun = hand.fill(f"{{{part}}}, then go on.")
    assert begun == f"{words[:1].upper()}{words[1:]}, then go on."


def test_a_refused_confirmation_says_what_is_in_its_way():
    assert refusal(None, KEYBOARD) == "release Shift first."
    standby = Reason.CONTROLLER_STANDBY
    assert refusal(standby, KEYBOARD) == f"controller standby. {standby.sentence(KEYBOARD)}"


def test_a_log_tells_which_hand_drove_and_an_older_one_reads_as_a_tracked_one():
    assert words_of({"hand": "keyboard"}) is KEYBOARD
    assert words_of({}) is words_of({"hand": "a glove"}) is OPENVR
    assert words_of_hand("keyboard") is KEYBOARD


@pytest.mark.parametrize(
    ("name", "device", "hand"),
    [
        ("tams.yaml", "auto", "sim"),
        ("tams.yaml", "keyboard", "keyboard"),
        ("lite6.yaml", "auto", "openvr"),
    ],
)
def test_what_drives_the_arm_is_known(name, device, hand):
    assert hand_of(load_config(CONFIG_DIRECTORY / name, {"controller.device": device})) == hand

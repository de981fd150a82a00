"""What to do about a stop, from the words that tell it."""

import pytest

from tams_app.teleop.advice import advice, what_to_do
from tams_app.teleop.reasons import Reason

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_its_sentence(reason):
    assert what_to_do(reason.label) == reason.sentence
    assert what_to_do(f"{reason.label}: eih, 1.2 s old") == reason.sentence


def test_a_detail_that_is_a_sentence_needs_only_how_to_go_on():
    assert what_to_do("arm refuses: Free the joint.") == "Release the trigger, then confirm."
    assert what_to_do("arm refuses: Free the joint, then confirm.") == ""


def test_words_that_are_no_reason_have_no_advice():
    assert what_to_do("") == ""
    assert what_to_do("something else: entirely") == ""


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("emergency stop", f"emergency stop. {Reason.EMERGENCY_STOP.sentence}"),
        (
            "arm refuses: Free the joint.",
            "arm refuses: Free the joint. Release the trigger, then confirm.",
        ),
        ("arm refuses: Free it, then confirm.", "arm refuses: Free it, then confirm."),
    ],
)
def test_what_happened_is_told_with_what_to_do(told, said):
    assert advice(told) == said

"""What the operator reads when the arming changes, and when a confirmation does not count."""

from dataclasses import replace

import pytest

from tams_app.session.observer import TickObserver
from tams_app.session.signals import Signals
from tams_app.session.status import StatusBoard
from tams_app.session.stops import StopWatch
from tams_app.study.trial import UnjudgedTrial
from tams_app.teleop.safety import ArmingState, Reason
from tests.session.test_parts import output

pytestmark = pytest.mark.untimed


class Follower:
    """Stands for the guard."""

    def follow(self, arming, stopping):
        """The guard is not looked at here."""


@pytest.fixture
def notes():
    return []


def observer(notes, arm_at_once=False):
    part, board = Follower(), StatusBoard(("gt",))
    return TickObserver(
        part,
        UnjudgedTrial(),
        StopWatch(lambda record: None),
        board,
        Signals(),
        lambda level, text: notes.append(text),
        arm_at_once,
    )


@pytest.mark.parametrize(
    ("reason", "detail", "told"),
    [
        (
            Reason.ARM_ERROR,
            "C31 (collision)",
            f"fault, arm error: C31 (collision). {Reason.ARM_ERROR.sentence}",
        ),
        (Reason.GUARD_LOST, "", f"fault, guard lost. {Reason.GUARD_LOST.sentence}"),
        (
            Reason.ARM_LINK_LOST,
            "The reports ended; check power and cable, then confirm.",
            "fault, arm link lost: The reports ended; check power and cable, then confirm.",
        ),
        (
            Reason.GRIPPER_FAILED,
            "The outputs are not what was commanded; check its plug.",
            "fault, gripper failed: The outputs are not what was commanded; check its plug. "
            "Release the trigger, then confirm.",
        ),
    ],
)
def test_a_fault_says_once_what_happened_and_what_to_do(notes, reason, detail, told):
    fault = replace(output(ArmingState.FAULT, reason), detail=detail)
    watching = observer(notes)
    for tick in range(3):
        watching.observe(tick, fault, None)
    assert notes == [told]


def test_a_confirmation_that_does_not_count_is_answered_every_time(notes):
    refused = replace(output(ArmingState.DISARMED), refusal="release the trigger first.")
    watching = observer(notes)
    for tick in (refused, replace(refused, refusal=""), refused):
        watching.observe(0, tick, None)
    assert notes == ["not confirmed: release the trigger first."] * 2


def test_nobody_is_told_where_nobody_confirmed(notes):
    refused = replace(output(ArmingState.DISARMED), refusal="release the trigger first.")
    observer(notes, arm_at_once=True).observe(0, refused, None)
    assert notes == []

"""What the operator reads when the arming changes, and who judges a trial."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tams_app.config import TrialConfig
from tams_app.records import Pose, SceneTruth
from tams_app.robot.control import Signals
from tams_app.robot.observers import HOT_ADVICE, ArmingNotes, HeatWatch
from tams_app.robot.trial import TrialObserver, task_geometry
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.teleop.hands import HANDS
from tams_app.teleop.records import Refusal
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_S
from tests.robot.test_parts import after, inputs, output

pytestmark = pytest.mark.untimed

WORDS = HANDS["openvr"]


def noting(arm_at_once=False, hand="openvr"):
    return ArmingNotes(Signals(), lambda: hand, arm_at_once)


def texts(observer, *outputs, arm=None):
    """The sentences that follow from these ticks."""
    steps = [observer.step(inputs(number, arm), each) for number, each in enumerate(outputs)]
    return [note.text for notes in steps for note in notes]


@pytest.mark.parametrize(
    ("reason", "detail", "told"),
    [
        (
            Reason.ARM_ERROR,
            "C31 (collision)",
            f"fault, arm error: C31 (collision). {Reason.ARM_ERROR.sentence(WORDS)}",
        ),
        (Reason.GUARD_LOST, "", f"fault, guard lost. {Reason.GUARD_LOST.sentence(WORDS)}"),
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
def test_a_fault_says_once_what_happened_and_what_to_do(reason, detail, told):
    fault = replace(output(ArmingState.FAULT, reason), detail=detail, lasting=reason)
    assert texts(noting(), fault, fault, fault) == [told]


def test_a_confirmation_that_does_not_count_is_answered_every_time():
    refused = replace(output(ArmingState.DISARMED), refusal=Refusal(None))
    notes = texts(noting(), refused, replace(refused, refusal=None), refused)
    assert notes == ["not confirmed: release the trigger first."] * 2


def test_what_is_noted_has_the_words_of_the_hand_in_use():
    held = replace(output(ArmingState.HOLDING, Reason.STALE_VIDEO), lasting=Reason.STALE_VIDEO)
    refused = replace(held, arming=ArmingState.FAULT, refusal=Refusal(None))
    notes = texts(noting(hand="keyboard"), held, refused)
    assert notes[0].endswith("wait until it is back, then release Shift.")
    assert notes[2] == "not confirmed: release Shift first."


def test_a_confirmation_names_what_is_in_its_way():
    refused = replace(output(ArmingState.DISARMED), refusal=Refusal(Reason.CONTROLLER_STANDBY))
    assert texts(noting(hand="keyboard"), refused) == [
        "not confirmed: controller standby. Click into the window that takes the keys, "
        "then release Shift."
    ]


def test_a_refusal_without_a_confirmation_is_not_noted():
    refused = replace(output(ArmingState.DISARMED), refusal=Refusal(None))
    assert texts(noting(arm_at_once=True), refused) == []


class Tried:
    """A trial whose block is in its place, and what is found; the gripper is closed at first."""

    def __init__(self, limited, block_z_m):
        self.clock, self.told, self.closed, self._limited = VirtualClock(), [], True, limited
        here = Pose(np.zeros(3), Rotation.identity())
        block = Pose(np.array([0.0, 0.0, block_z_m]), Rotation.identity())
        self._scene = SceneTruth(0, block, here, here, 0.0, 0.016)
        self.trial = TrialObserver(TrialConfig())

    def look(self):
        arm = SimpleNamespace(gripper_closed=self.closed)
        found = self.trial.look(self.clock.now_ns(), self._scene, arm, self._limited)
        self.told += ["placed"] * found.placed + ["ended"] * found.over
        return found.over

    def begin(self):
        self.trial.receive(after(output(ArmingState.ENGAGED), self.clock.now_ns()))


@pytest.mark.parametrize("limited", [True, False])
def test_only_a_limited_trial_ends_when_its_time_is_over(limited):
    tried = Tried(limited, 0.0)
    tried.begin()
    tried.clock.advance_ns(round(TrialConfig().limit_s * 1e9) + 1)
    assert tried.look() is limited
    assert tried.told == ["ended"] * limited


@pytest.mark.parametrize("limited", [True, False])
def test_only_a_limited_trial_ends_when_the_block_is_placed(limited):
    tried = Tried(limited, task_geometry().block_rest_height)
    tried.begin()
    assert not tried.look()
    tried.closed = False
    assert not tried.look()
    for _ in range(3):
        tried.clock.advance_ns(NS_PER_S)
        assert tried.look() is limited
        if limited:
            break
    assert tried.told == (["placed", "ended"] if limited else ["placed"])
    assert tried.trial.outcome("ended by q").completion_time_s == 0.0


def test_a_block_that_is_put_back_is_judged_anew_and_the_first_placed_trial_is_the_verdict():
    tried = Tried(False, task_geometry().block_rest_height)
    trial, clock, told = tried.trial, tried.clock, tried.told

    def places(after_s):
        tried.closed = True
        tried.begin()
        tried.look()
        clock.advance_ns(after_s * NS_PER_S)
        tried.closed = False
        for _ in range(3):
            tried.look()
            clock.advance_ns(NS_PER_S)

    trial.again()
    assert trial.outcome("").completed is False
    places(3)
    assert told == ["placed"]
    trial.again()
    clock.advance_ns(20 * NS_PER_S)
    assert told == ["placed"]
    places(7)
    assert told == ["placed", "placed"]
    trial.again()
    assert trial.outcome("ended by q").completion_time_s == 3.0


def test_the_operator_is_warned_of_a_hot_motor_and_again_only_when_it_is_hotter() -> None:
    watch, notes, counts = HeatWatch(hot_c=70.0), [], []
    for hottest_c in (None, 69, 70, 74, 69, 70, 75, 79, 80):
        arm = None if hottest_c is None else SimpleNamespace(hottest_motor_c=hottest_c)
        notes += texts(watch, output(ArmingState.ENGAGED), arm=arm)
        counts.append(len(notes))
    assert counts == [0, 0, 1, 1, 1, 1, 2, 2, 3]
    assert notes[0] == f"a motor of the arm has 70 °C: {HOT_ADVICE}"

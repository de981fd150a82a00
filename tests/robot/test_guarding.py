"""The guard follows the arm's arming."""

import contextlib
from contextlib import ExitStack
from dataclasses import replace

import pytest

from hw.guard.link import GuardLink, GuardMemory
from hw.guard.motion import Cause, Motion
from tams_app.config import load_config
from tams_app.errors import DeviceError
from tams_app.records import Twist
from tams_app.robot.control import Signals
from tams_app.robot.guarding import Guarding
from tams_app.runtime.shared_ring import new_block_name
from tams_app.teleop.safety import ArmingState, Reason
from tests.robot.test_parts import after, output

pytestmark = pytest.mark.waiting

SILENCE_NS = 200_000_000
CONFIG = load_config()
ARM_AND_LIMITS = (CONFIG.arm, CONFIG.limits)


class ScriptedLink:
    """A guard that lives and says what it is told to."""

    latched = False
    cause = Cause.NONE
    arm_lost = False
    ended = False
    armed = True
    fresh = True

    def __init__(self):
        self.beats = []

    def beat(self, now_ns, motion, deadman, speed):
        self.beats.append((motion, deadman, speed))

    def answers(self, now_ns):
        return not self.armed or (self.fresh and not self.ended)

    def is_fresh(self, now_ns):
        return self.fresh


@pytest.fixture
def signals():
    return Signals()


@pytest.fixture
def notes():
    return []


@pytest.fixture
def guard(tmp_path, signals, notes):
    return Guarding(*ARM_AND_LIMITS, tmp_path, signals, lambda level, text: notes.append(text))


@pytest.fixture
def link(guard):
    guard._link = ScriptedLink()
    return guard._link


@pytest.fixture
def silent(guard):
    guard._link = GuardLink(GuardMemory(new_block_name()), SILENCE_NS, lambda: True)
    yield guard
    guard.close()


@pytest.fixture
def faults(guard, link, signals):
    """What a tick finds of a guard whose link has these attributes."""

    def found(**attributes):
        vars(link).update(attributes)
        guard.before_tick(0)
        return signals.take(0).faults

    return found


def test_the_guard_stays_armed_until_a_fault_has_stopped_the_arm(silent):
    armed = []
    for arming, stopping in (
        (ArmingState.DISARMED, True),
        (ArmingState.READY, False),
        (ArmingState.FAULT, True),
        (ArmingState.FAULT, False),
    ):
        silent.receive(after(replace(output(arming), stop=stopping)))
        armed.append(silent._link.armed)
    assert armed == [False, True, True, False]


def test_a_stop_by_the_guard_is_one_fault_for_each_time_it_latches(faults, notes):
    taken = [faults(latched=latched) for latched in (False, True, True, False, True)]
    stopped = (Reason.GUARD_STOPPED,)
    assert taken == [(), stopped, (), (), stopped]
    assert len(notes) == 2


def test_a_guard_that_does_not_answer_is_a_fault(silent, signals):
    silent.receive(after(output(ArmingState.READY)))
    silent.before_tick(0)
    assert signals.take(0).faults == ()
    silent.before_tick(SILENCE_NS + 1)
    assert signals.take(0).faults == (Reason.GUARD_SILENT,)


def test_silence_while_armed_is_a_fault_until_the_guard_answers_again_armed_or_not(faults):
    states = ((True, False), (True, False), (False, False), (False, True), (True, True))
    taken = [faults(armed=armed, fresh=fresh) for armed, fresh in states]
    silent = (Reason.GUARD_SILENT,)
    assert taken == [silent, silent, silent, (), ()]


def test_silence_while_disarmed_is_none(faults):
    assert faults(armed=False, fresh=False) == ()


def test_a_guard_whose_process_has_ended_is_a_fault_for_good(faults):
    for armed in (True, False):
        assert faults(ended=True, armed=armed) == (Reason.GUARD_LOST,)


def test_a_guard_that_cannot_reach_the_arm_is_a_fault_for_as_long_as_it_lasts(faults):
    blind = (Reason.GUARD_BLIND,)
    taken = [faults(arm_lost=lost) for lost in (False, True, True, False)]
    assert taken == [(), blind, blind, ()]


@pytest.mark.parametrize(
    ("cause", "reason"),
    [
        (Cause.SILENT, Reason.GUARD_STOPPED),
        (Cause.UNASKED, Reason.ARM_MOVED_UNASKED),
        (Cause.TOO_FAST, Reason.ARM_TOO_FAST),
        (Cause.OUTSIDE, Reason.ARM_OUTSIDE),
        (Cause.SLEPT, Reason.COMPUTER_SLEPT),
    ],
)
def test_the_cause_of_the_guards_stop_is_a_reason_of_its_own(faults, notes, cause, reason):
    assert faults(latched=True, cause=cause) == (reason,)
    assert notes == [f"the guard process has stopped the arm: {reason.label}"]


def test_each_beat_says_what_the_tick_before_commanded(guard, link):
    ready = replace(output(ArmingState.READY), deadman=False, twist=None)
    engaged = output(ArmingState.ENGAGED)
    moving = Twist((0.03, 0.0, -0.04), (0.0, 0.0, 0.0))
    still, follows = replace(ready, twist=Twist.zero()), replace(engaged, twist=moving)
    for now_ns, each in enumerate((still, replace(follows, deadman=True), ready)):
        guard.receive(after(each))
        guard.before_tick(now_ns)
    motions, deadmen, speeds = zip(*link.beats, strict=True)
    follow, rest = Motion.FOLLOW, Motion.REST
    assert motions == (rest, follow, rest)
    assert deadmen == (False, True, False)
    assert speeds == pytest.approx((0.0, 0.05, 0.0))


def test_on_the_way_home_a_beat_says_so_and_how_fast_a_joint_may_turn(tmp_path):
    guard = Guarding(*ARM_AND_LIMITS, tmp_path, Signals(), lambda level, text: None, home_rad_s=0.2)
    guard._link = link = ScriptedLink()
    for arming in (ArmingState.READY, ArmingState.ENGAGED, ArmingState.DISARMED):
        held = arming is ArmingState.ENGAGED
        guard.receive(after(replace(output(arming), twist=None, stop=True, deadman=held)))
        guard.before_tick(0)
    assert link.beats == [
        (Motion.REST, False, 0.0),
        (Motion.HOME, True, 0.2),
        (Motion.REST, False, 0.0),
    ]


@pytest.mark.parametrize(
    ("acknowledged", "latched", "after_ms", "watches"),
    [
        (True, False, 0, True),
        (True, False, 100, True),
        (True, False, 101, False),
        (False, False, 0, False),
        (True, True, 0, False),
    ],
)
def test_the_guard_watches_once_it_has_answered_and_while_it_has_no_cause_to_stop(
    guard, acknowledged, latched, after_ms, watches
):
    assert not guard.watches(0)
    guard._link = link = ScriptedLink()
    link.acknowledged = acknowledged
    beat_ns = 1_000_000_000
    guard.before_tick(beat_ns)
    link.latched = latched
    assert guard.watches(beat_ns + after_ms * 1_000_000) is watches


class NotedGuarding(Guarding):
    def __init__(self, calls, directory):
        super().__init__(*ARM_AND_LIMITS, directory, Signals(), lambda level, text: None)
        self.calls = calls

    def start(self):
        self.calls.append("guard starts")

    def wait_ready(self):
        self.calls.append("guard ready")

    def close(self):
        self.calls.append("guard ends")


class NotedArm:
    def __init__(self, calls, refusal=""):
        self.calls, self.refusal = calls, refusal

    def connect(self):
        self.calls.append("arm connects")

    def close(self):
        self.calls.append("arm stands")
        if self.refusal:
            raise DeviceError(self.refusal)


def test_the_arm_stands_before_its_guard_ends_also_where_connecting_failed(tmp_path):
    for fails in (False, True):
        calls = []
        arm = NotedArm(calls)

        def connect(arm=arm, fails=fails):
            arm.connect()
            if fails:
                raise DeviceError("it does not answer")

        with contextlib.suppress(DeviceError), ExitStack() as stack:
            NotedGuarding(calls, tmp_path).join(arm, stack, connect)
            calls.append("in use")
        assert calls[:2] == ["guard starts", "arm connects"]
        assert calls[-2:] == ["arm stands", "guard ends"]
        assert calls[2:-2] == ([] if fails else ["guard ready", "in use"])


def test_an_unacknowledged_stop_is_told_beside_what_happened_before(tmp_path):
    def lose(arm):
        with ExitStack() as stack:
            NotedGuarding([], tmp_path).join(arm, stack, arm.connect)
            raise DeviceError("The arm is gone.")

    with pytest.raises(DeviceError) as failed:
        lose(NotedArm([], "The arm did not acknowledge its last stop."))
    assert str(failed.value) == "The arm is gone; and the arm did not acknowledge its last stop."

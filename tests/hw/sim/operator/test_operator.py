from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from hw.sim.layout import draw_layout
from hw.sim.operator.hand import REST_POSITION_M
from hw.sim.operator.operator import HandActivity
from hw.sim.operator.servoing import Percept
from hw.sim.operator.task import Stage
from tams_app.config import OperatorConfig
from tams_app.records import ControllerSample, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.teleop.motion import CLAMP_ABOVE_M_S, CLAMP_ABOVE_RAD_S
from tams_app.units import NS_PER_S
from tests.hw.sim.operator.toy_robot import TICK_NS, Trial

pytestmark = pytest.mark.untimed

SEEDS = range(5)


@dataclass(frozen=True)
class Result:
    trial: Trial
    samples: list[ControllerSample]
    armed_s: float  # from the start to the first engagement
    worked_s: float  # from the first engagement to the end


def _work(trial: Trial, seconds: float = 100.0) -> Result:
    samples: list[ControllerSample] = []
    armed_s = 0.0
    while trial.operator.activity is not HandActivity.FINISHED:
        samples.append(trial.tick())
        assert len(samples) * TICK_NS < seconds * NS_PER_S, trial.operator.stage
        if not trial.robot.engagements:
            armed_s = len(samples) * TICK_NS / NS_PER_S
    return Result(trial, samples, armed_s, len(samples) * TICK_NS / NS_PER_S - armed_s)


def _goes_on(trial: Trial) -> None:
    """The arm follows again, and the block is lowered."""
    before = trial.robot.engagements
    trial.run_until(Stage.LOWER)
    assert trial.robot.engagements > before
    assert trial.robot.attached is not None


def _trial(seed: int, **conditions) -> Trial:
    return Trial(draw_layout(seed), seed, **conditions)


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return [_work(_trial(seed)) for seed in SEEDS]


# --- the whole task -----------------------------------------------------------------------------


@pytest.mark.verify
def test_every_seed_ends_with_the_block_in_the_container(results):
    assert all(result.trial.robot.placed() for result in results)


def test_a_trial_takes_a_person_s_time(results):
    times = [result.worked_s for result in results]
    assert max(times) < 30.0
    assert 12.0 < np.mean(times) < 25.0


def test_the_hand_stays_within_reach_and_re_clutches_instead(results):
    reach = OperatorConfig().arm_reach_m
    for result in results:
        offsets = np.array([sample.pose.position for sample in result.samples]) - REST_POSITION_M
        assert np.linalg.norm(offsets, axis=1).max() < reach
        assert result.trial.robot.engagements >= 2


def test_the_hand_moves_like_a_hand(results):
    for result in results:
        positions = np.array([sample.pose.position for sample in result.samples])
        speeds = np.linalg.norm(np.diff(positions, axis=0), axis=1) * NS_PER_S / TICK_NS
        assert 0.2 < speeds.max() < 0.6 * CLAMP_ABOVE_M_S
        turns = [sample.pose.rotation for sample in result.samples[::10]]
        steps = [(b * a.inv()).magnitude() for a, b in pairwise(turns)]
        assert max(steps) * NS_PER_S / (10 * TICK_NS) < 0.6 * CLAMP_ABOVE_RAD_S


def test_the_gripper_is_turned_in_orientation_mode_and_moved_in_translation_mode(results):
    turned = [result for result in results if result.trial.robot.toggles]
    assert len(turned) >= 2
    assert all(result.trial.robot.toggles == 2 for result in turned)


def test_the_trigger_is_free_before_and_after_the_work(results):
    for result in results:
        confirming = [sample for sample in result.samples if sample.menu]
        assert len(confirming) * TICK_NS > 1.1 * NS_PER_S
        assert all(sample.trigger == 0.0 for sample in confirming)
        assert result.samples[-1].trigger == 0.0


def test_participants_differ_and_the_same_participant_repeats(results):
    again = _trial(3).run(6.0)
    for first, second in zip(results[3].samples, again, strict=False):
        assert (first.pose.position == second.pose.position).all()
        assert first.trigger == second.trigger
    other = Trial(draw_layout(3), seed=4).run(6.0)
    assert (other[-1].pose.position != again[-1].pose.position).any()


@pytest.mark.parametrize(
    "conditions",
    [
        {"lag_s": 0.15, "view_delay_s": 0.4},
        {"misaligned": Rotation.from_rotvec([0.1, 0.15, 0.2])},
        {"scale": 0.6},
        {"scale": 1.4},
    ],
    ids=str,
)
def test_what_the_operator_does_not_know_of_the_robot_is_corrected_by_sight(conditions):
    trial = _trial(5, **conditions)
    _work(trial, seconds=45.0)
    assert trial.robot.placed()


def test_a_late_view_and_a_lagging_arm_cause_no_oscillation():
    trial = _trial(1, lag_s=0.15, view_delay_s=0.3)
    target = trial.robot.block.position[:2].copy()
    along = target - trial.robot.position[:2]
    along /= np.linalg.norm(along)
    beyond = []
    while trial.operator.stage is Stage.REACH:
        trial.tick()
        beyond.append(float((trial.robot.position[:2] - target) @ along))
    assert max(beyond) < 0.008
    last_pass = next(index for index, gap in enumerate(beyond) if gap > -0.01)
    assert min(beyond[last_pass:]) > -0.015


# --- when things go wrong -----------------------------------------------------------------------


def test_a_missed_grasp_is_seen_and_tried_again():
    trial = _trial(2)
    trial.robot.slips_left = 1
    samples = []
    while trial.operator.stage is not Stage.CARRY:
        samples.append(trial.tick())
        assert len(samples) < 60 * 120
    assert sum(b.a and not a.a for a, b in pairwise(samples)) == 2
    assert trial.robot.attached is not None


def test_a_block_dropped_on_the_way_is_picked_up_again():
    trial = _trial(2)
    trial.run_until(Stage.CARRY)
    trial.run(1.5)
    x, y, _ = trial.robot.block.position
    trial.robot.attached = None
    trial.robot.block = Pose(np.array([x, y, 0.01]), trial.robot.block.rotation)
    trial.run_until(Stage.OPEN, seconds=3.0)
    trial.run_until(Stage.CARRY)
    assert trial.robot.attached is not None


def test_a_held_robot_makes_the_operator_let_go_and_try_again():
    trial = _trial(0)
    trial.run_until(Stage.CARRY)
    trial.robot.held = True
    samples = trial.run(15.0)
    squeezes = sum(b.trigger > 0.0 == a.trigger for a, b in pairwise(samples))
    assert squeezes > 5
    assert not any(sample.menu for sample in samples)
    trial.robot.held = False
    _goes_on(trial)


def test_who_feels_the_arm_s_answer_late_waits_for_it_the_next_time():
    """On a far link the pulse comes when the trigger was released again."""
    trial = _trial(0)
    operator, coming = trial.operator, []
    feel = operator.feel
    operator.feel = lambda haptic: coming.append((trial.now_ns, haptic))
    while operator.activity is not HandActivity.FINISHED:
        trial.tick()
        while coming and trial.now_ns - coming[0][0] >= 1.2 * NS_PER_S:
            feel(coming.pop(0)[1])
        assert trial.now_ns < 100 * NS_PER_S, operator.stage
    assert trial.robot.placed()


def test_an_arm_that_was_not_armed_is_confirmed_again():
    trial = _trial(0)
    trial.run(1.9)
    assert trial.robot.arming == "ready"
    trial.robot.arming = "disarmed"
    while not trial.robot.engagements:
        trial.run(0.1)
        assert trial.now_ns < 60 * NS_PER_S


def test_an_operator_who_does_not_arm_never_touches_the_menu():
    trial = _trial(0, confirms=False)
    samples = trial.run(10.0)
    trial.robot.arming = "ready"
    samples += trial.run(8.0)
    assert trial.robot.engagements
    assert not any(sample.menu for sample in samples)


def test_a_robot_that_moves_by_itself_is_left_alone_until_it_stands():
    trial = _trial(0, confirms=False)
    trial.robot.arming = "ready"
    for _ in range(360):
        trial.robot.position = trial.robot.position + np.array([0.0, 0.0, 0.0004])
        assert trial.tick().trigger == 0.0
    assert any(sample.trigger == 1.0 for sample in trial.run(1.0))


def test_an_arm_that_quietly_ignores_the_hand_makes_the_operator_let_go():
    trial = _trial(0)
    trial.run_until(Stage.CARRY)
    trial.robot.deaf = True
    samples = trial.run(3.0)
    assert min(sample.trigger for sample in samples) == 0.0
    trial.robot.deaf = False
    trial.run_until(Stage.LOWER)


def test_the_wrong_mode_is_found_out_and_toggled():
    trial = _trial(0)
    trial.robot.turning = True
    trial.run_until(Stage.CLOSE)
    assert trial.robot.toggles % 2 == 1


def test_a_fault_is_left_to_the_experimenter_at_the_console():
    trial = _trial(0)
    trial.run_until(Stage.LIFT)
    assert trial.run(0.7)[-1].trigger == 1.0
    trial.robot.fault()
    assert trial.run(0.15)[-1].trigger == 0.0
    samples = trial.run(10.0)
    assert not any(sample.menu for sample in samples)
    assert sum(sample.trigger > 0.0 for sample in samples) < 0.2 * len(samples)
    trial.robot.arming = "ready"
    _goes_on(trial)


def test_a_link_that_was_away_is_confirmed_twice_and_the_task_goes_on():
    """Each confirmation after a squeeze that showed that the arm does not answer."""
    trial = _trial(0)
    trial.run_until(Stage.LIFT)
    trial.robot.fault(Haptic.LINK_FAULT)
    assert trial.run(0.15)[-1].trigger == 0.0
    samples = []
    while trial.robot.arming != "engaged":
        samples += trial.run(0.1)
        assert len(samples) < 12 * 120
    presses = [after.menu and not before.menu for before, after in pairwise(samples)]
    assert sum(presses) == 2
    trial.run_until(Stage.LOWER)


# --- eyes ---------------------------------------------------------------------------------------


def test_the_operator_confirms_only_with_an_image_in_sight():
    trial = _trial(0)
    trial.showing = False
    samples = trial.run(3.0)
    assert not any(sample.menu or sample.trigger for sample in samples)
    trial.showing = True
    assert any(sample.menu for sample in trial.run(1.0))


def test_a_frozen_image_makes_the_operator_stop_and_let_go():
    trial = _trial(0)
    trial.run_until(Stage.CARRY)
    trial.run(1.0)
    trial.showing = False
    trial.run(1.0)
    rest = trial.robot.position.copy()
    assert all(sample.trigger == 0.0 for sample in trial.run(2.0))
    assert trial.robot.position == pytest.approx(rest, abs=1e-3)
    trial.showing = True
    _goes_on(trial)


def test_an_image_that_vanishes_makes_the_operator_let_go_at_once():
    trial = _trial(0)
    trial.run_until(Stage.DESCEND)
    trial.run(1.0)
    trial.seen, trial.showing = None, False
    assert trial.run(0.2)[-1].trigger == 0.0


def test_an_ageing_view_slows_the_operator_down():
    fresh = _work(_trial(6, view_delay_s=0.3)).worked_s
    old = _work(_trial(6, view_delay_s=0.65)).worked_s
    assert old > fresh + 5.0


def test_the_operator_acts_on_percepts_alone():
    """Shifted percepts lead to the shifted place, with the true scene nowhere in reach."""
    trial = _trial(0)
    shift = np.array([0.02, 0.03, 0.0])

    class Misled:
        def __init__(self, eyes) -> None:
            self._eyes = eyes

        def look(self, now_ns: int) -> Percept | None:
            percept = self._eyes.look(now_ns)
            if percept is not None:
                percept.block.position[:] = truth + shift
            return percept

    truth = trial.robot.block.position.copy()
    trial.operator._perception = Misled(trial.operator._perception)
    trial.run_until(Stage.DESCEND)
    assert trial.robot.position[:2] == pytest.approx((truth + shift)[:2], abs=0.006)

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.prediction.forward_model import ArmHeard, Forecast, ForwardModel, Trail
from tams_app.teleop.safety import ArmingState
from tests.prediction.sides import MODEL, READY_JOINTS, Sides
from tests.teleop.motions import within
from tests.teleop.rig import PERIOD_NS, hand_for, make_config

pytestmark = pytest.mark.untimed

delays = st.integers(0, 48)
velocities = st.lists(within(0.12), min_size=1, max_size=4)


@settings(max_examples=15)
@given(delays, delays, velocities)
def test_the_arm_is_where_it_is_predicted_whatever_the_hand_does(way, back, path):
    sides = Sides(way, back)
    sides.engage()
    errors = []
    for velocity in path:
        sides.hand.linear = hand_for(velocity, sides.config)
        errors += sides.errors_m(30)
    assert max(errors) < 2e-3


@settings(max_examples=10)
@given(delays, delays, velocities)
def test_the_arm_comes_to_where_it_is_commanded_once_the_samples_have_taken_effect(way, back, path):
    sides = Sides(way, back)
    sides.engage()
    commanded, reached = [], []
    for velocity in path:
        sides.hand.linear = hand_for(velocity, sides.config)
        for _ in range(60):
            sides.step()
            commanded.append(MODEL.tcp_pose(sides.model.at(sides.now_ns).commanded).position)
            reached.append(MODEL.tcp_pose(sides.arm.joints).position)
    apart = np.array(commanded[: len(commanded) - way]) - np.array(reached[way:])
    assert np.linalg.norm(apart, axis=1).max() < 2e-3


def turned(sides):
    """How far the arm turns in half a second, and how far off that is predicted [rad]."""
    before = MODEL.tcp_pose(sides.arm.joints).rotation
    sides.hand.angular = np.array([0.0, 0.0, 0.4])
    apart = []
    for _ in range(60):
        sides.step()
        true = MODEL.tcp_pose(sides.arm.joints).rotation
        predicted = MODEL.tcp_pose(sides.model.at(sides.now_ns).joints).rotation
        apart.append((predicted * true.inv()).magnitude())
    return (true * before.inv()).magnitude(), max(apart)


def test_a_hand_that_turns_is_followed_in_orientation_mode():
    sides = Sides(12, 12)
    sides.engage()
    sides.hand.grip = 1.0
    sides.step(3)
    sides.hand.grip = 0.0
    turn, apart = turned(sides)
    assert turn > 0.1
    assert apart < 0.01


def test_a_press_moves_the_prediction_before_the_robot_s_side_has_told_of_it():
    sides = Sides(way=6, back=40)
    sides.step(50)
    sides.hand.trigger = 1.0
    sides.hand.linear = hand_for((0.1, 0.0, 0.0), sides.config)
    sides.step(30)  # what was received is of before the press
    moved = sides.arm.joints - READY_JOINTS
    assert np.abs(moved).max() > 0.01
    assert sides.error_m() < 1e-3


def test_an_arm_in_fault_is_predicted_to_stand_whatever_the_trigger_does():
    sides = Sides(way=4, back=4)
    sides.step(10, estop=True)
    sides.hand.trigger = 1.0
    sides.hand.linear = hand_for((0.1, 0.0, 0.0), sides.config)
    for _ in range(40):
        sides.step(arm_ready=False)
        assert sides.output.arming is ArmingState.FAULT
        assert sides.error_m() == 0.0  # also before the state that follows the press has come


def test_a_stop_that_only_the_robot_s_side_knows_ends_the_predicted_motion():
    sides = Sides(way=4, back=12)
    sides.move(0.1, 0.0, 0.0)
    sides.step(30)
    sides.step(1, estop=True)
    sides.step(40)
    assert sides.error_m() < 1e-9


def test_an_arm_that_follows_late_is_predicted_so():
    sides = Sides(way=6, back=6, lag=12)
    sides.engage()
    for direction in (0.12, -0.12):
        sides.hand.linear = hand_for((direction, 0.0, 0.0), sides.config)
        assert max(sides.errors_m(40)) < 3e-3


def test_an_operator_s_side_that_begins_later_learns_of_the_mode():
    sides = Sides(way=6, back=6)
    sides.engage()
    sides.hand.grip = 1.0
    sides.step(10)
    sides.hand.grip = sides.hand.trigger = 0.0
    sides.step(10)
    sides.model = ForwardModel(sides.config, MODEL, sides.ready)
    sides.engage()
    assert sides.output.orientation_mode
    turn, apart = turned(sides)
    assert turn > 0.1
    assert apart < 0.01


def test_an_arm_that_slows_down_near_its_reach_is_predicted_so():
    sides = Sides(way=12, back=12)
    sides.move(0.2, 0.0, 0.15)
    scales, errors = [], []
    for _ in range(150):
        sides.step()
        scales.append(sides.output.speed_scale)
        errors.append(sides.error_m())
    assert min(scales) < 0.6
    assert max(errors) < 4e-3


def test_a_slowed_arm_is_predicted_as_slow():
    sides = Sides(way=6, back=6)
    sides.move(0.15, 0.0, 0.0)
    slow_ns = 700_000_000  # of video, at which the arm is slowed and does not hold
    sides.step(40, video_age_ns=slow_ns)
    assert 0.0 < sides.output.speed_scale < 1.0
    assert max(sides.errors_m(40, video_age_ns=slow_ns)) < 1e-3


def test_the_error_of_earlier_predictions_is_told_with_each():
    sides = Sides(way=12, back=12)
    sides.move(0.1, 0.0, 0.0)
    sides.errors_m(40)
    assert sides.model.at(sides.now_ns).error_m < 2e-3
    sides.arm.joints = sides.arm.joints + 0.05  # a jump that no command caused
    sides.errors_m(20)
    assert sides.model.at(sides.now_ns).error_m > 0.01


@pytest.mark.parametrize(
    ("error_m", "late_m", "trusted"),
    [
        (0.010, 0.0, True),  # good
        (0.011, 0.021, False),  # bad, and what is not predicted is not much worse
        (0.011, 0.023, True),  # much better than nothing
        (0.030, 0.080, True),
        (0.031, 0.500, False),  # too far off, whatever else there is
    ],
)
def test_predictions_are_trusted_that_are_good_or_much_better_than_none(error_m, late_m, trusted):
    assert Forecast(READY_JOINTS, READY_JOINTS, error_m, late_m).is_trusted is trusted


def test_how_far_off_the_newest_state_was_is_told_beside_the_error_of_predictions():
    sides = Sides(way=24, back=24)
    sides.move(0.1, 0.0, 0.0)
    sides.errors_m(100)
    forecast = sides.model.at(sides.now_ns)
    assert forecast.error_m < 2e-3
    assert forecast.late_m == pytest.approx(0.1 * 24 / 120, abs=3e-3)
    assert forecast.is_trusted


def test_an_error_is_forgotten_after_two_seconds():
    sides = Sides(way=2, back=2)
    sides.step(20)
    sides.arm.joints = sides.arm.joints + 0.05
    sides.errors_m(10)
    assert sides.model.at(sides.now_ns).error_m > 0.01
    sides.errors_m(260)
    assert sides.model.at(sides.now_ns).error_m < 1e-6


def test_an_operator_s_computer_that_stood_still_predicts_no_motion_of_that_time():
    """No sample came there either, and the arm's own deadman has stopped it."""
    sides = Sides(way=0, back=0)
    sides.move(0.2, 0.0, 0.0)
    sides.step(30)
    joints = sides.model.at(sides.now_ns).joints
    later_ns = sides.now_ns + 2_000_000_000
    sides.model.sent(sides.hand.sample(later_ns, 0.0), later_ns)
    assert sides.model.at(later_ns).joints == pytest.approx(joints, abs=0.02)


def test_the_past_is_as_it_was_measured():
    sides = Sides(way=3, back=3)
    sides.move(0.1, 0.0, 0.0)
    sides.step(20)
    then_ns, joints = sides.now_ns, sides.arm.joints
    sides.step(10)
    past = sides.model.at(then_ns)
    assert past.joints == pytest.approx(joints, abs=1e-12)
    assert past.error_m == 0.0


def test_nothing_is_predicted_before_the_first_state():
    model = ForwardModel(make_config(), MODEL, MODEL.tcp_pose(READY_JOINTS).rotation)
    assert model.at(1) is None


def test_a_state_that_is_older_than_the_last_is_left_out():
    model = ForwardModel(make_config(), MODEL, MODEL.tcp_pose(READY_JOINTS).rotation)

    def state(t_ns: int, joints: np.ndarray) -> ArmHeard:
        return ArmHeard(t_ns, joints, None, ArmingState.READY, False, 1.0)

    model.heard(state(2 * PERIOD_NS, READY_JOINTS), 0)
    model.heard(state(PERIOD_NS, READY_JOINTS + 1.0), 0)
    assert model.at(3 * PERIOD_NS).joints == pytest.approx(READY_JOINTS)


# --- trails ---------------------------------------------------------------------------------------


times = st.lists(st.integers(0, 10_000), min_size=1, max_size=20, unique=True).map(sorted)


@given(times, st.integers(-100, 10_100))
def test_a_trail_is_linear_between_its_samples_and_constant_beyond_them(stamps, t_ns):
    trail = Trail(1 << 40)
    for stamp in stamps:
        trail.add(stamp, np.array([float(stamp) ** 2]))
    expected = np.interp(t_ns, stamps, np.square(stamps, dtype=float))
    assert trail.at(t_ns) == pytest.approx([expected])


@given(times, st.integers(0, 3000))
def test_a_trail_keeps_what_is_asked_for(stamps, kept_ns):
    trail, whole = Trail(kept_ns), Trail(1 << 40)
    for stamp in stamps:
        trail.add(stamp, np.array([float(stamp)]))
        whole.add(stamp, np.array([float(stamp)]))
    for t_ns in range(max(stamps[0], stamps[-1] - kept_ns), stamps[-1] + 1, 97):
        assert trail.at(t_ns) == pytest.approx(whole.at(t_ns))


def test_a_trail_forgets_what_is_older():
    trail = Trail(100)
    for stamp in range(0, 10_000, 10):
        trail.add(stamp, np.zeros(1))
    assert len(trail) <= 12


def test_a_sample_that_is_not_newer_is_left_out():
    trail = Trail(100)
    trail.add(50, np.ones(1))
    trail.add(50, np.zeros(1))
    trail.add(40, np.zeros(1))
    assert len(trail) == 1
    assert trail.newest[1] == pytest.approx([1.0])


def test_a_trail_may_go_on_for_a_while_as_it_went_last():
    trail = Trail(1000)
    trail.add(100, np.array([1.0]))
    assert trail.at(150, ahead_ns=40) == pytest.approx([1.0])  # one sample has no direction
    trail.add(110, np.array([3.0]))
    assert trail.at(115, ahead_ns=40) == pytest.approx([4.0])
    assert trail.at(150, ahead_ns=40) == pytest.approx([11.0])
    assert trail.at(500, ahead_ns=40) == pytest.approx([11.0])
    assert trail.at(500) == pytest.approx([3.0])
    assert trail.at(105, ahead_ns=40) == pytest.approx([2.0])

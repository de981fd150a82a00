from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hw.lite6.kinematics import Lite6Model, links, offset_from_mm_deg
from hw.sim.controller.joint_servo import CYCLE_S, TwistServo, check_motion
from tams_app.records import Twist
from tams_app.teleop.limits import Limits
from tams_app.teleop.safety import Reason
from tams_app.teleop.servo import Tcp
from tams_app.vectors import ZERO, floats, norm, times
from tests.teleop.rig import READY_ROTATION, RoomyModel, make_config

pytestmark = pytest.mark.waiting

JOINTS = np.zeros(6)
MIDDLE = Tcp((0.33, 0.0, 0.18), READY_ROTATION)
NOTHING = np.zeros(3)


class StiffModel(RoomyModel):
    """Joint 1 must turn `gearing` rad for each metre along x; beyond that it is roomy."""

    def __init__(self, gearing: float) -> None:
        self._gearing = gearing

    def jacobian(self, joints: np.ndarray) -> np.ndarray:
        jacobian = np.eye(6)
        jacobian[0, 0] = 0.0 if np.isinf(self._gearing) else 1.0 / self._gearing
        return jacobian


def limits(model: RoomyModel | None = None) -> Limits:
    return Limits(make_config(), model or RoomyModel(), READY_ROTATION)


def test_the_norm_is_limited_and_the_direction_kept() -> None:
    asked = Twist(np.array([0.6, -0.8, 0.0]), np.array([0.0, 3.0, 4.0]))
    left = limits().limit(asked, MIDDLE, JOINTS, 1.0).twist
    np.testing.assert_allclose(left.linear, [0.15, -0.2, 0])
    np.testing.assert_allclose(left.angular, [0, 0.3, 0.4])


def test_an_old_frame_scales_all_of_the_twist() -> None:
    asked = Twist(np.array([0.2, 0, 0]), np.array([0, 0, 0.4]))
    left = limits().limit(asked, MIDDLE, JOINTS, 0.25)
    np.testing.assert_allclose(left.twist.linear, [0.05, 0, 0])
    np.testing.assert_allclose(left.twist.angular, [0, 0, 0.1])
    assert left.limited_by is None
    assert limits().limit(asked, MIDDLE, JOINTS, 0.0).twist.is_zero


@pytest.mark.parametrize(
    ("share", "scale"), [(0.1, 1.0), (0.699, 1.0), (0.7, 1.0), (0.8, 0.875), (1.4, 0.5), (7, 0.1)]
)
def test_joint_speeds_never_exceed_their_share_of_the_limit(share: float, scale: float) -> None:
    stiff = limits(StiffModel(share * np.pi / 0.2))
    left = stiff.limit(Twist(np.array([0.2, 0, 0]), NOTHING), MIDDLE, JOINTS, 1.0)
    assert left.joint_scale == pytest.approx(scale)
    assert left.twist.linear[0] == pytest.approx(0.2 * scale)
    free = stiff.limit(Twist(np.array([0, 0.2, 0]), NOTHING), MIDDLE, JOINTS, 1.0)
    assert free.joint_scale == 1.0


@pytest.mark.parametrize("gearing", [1e9, np.inf, np.nan])
def test_a_singular_posture_leaves_nothing_and_says_so(gearing: float) -> None:
    left = limits(StiffModel(gearing)).limit(
        Twist(np.array([0.2, 0, 0]), NOTHING), MIDDLE, JOINTS, 1.0
    )
    assert np.abs(left.twist.linear).max() < 1e-6
    assert left.limited_by is Reason.SINGULARITY


class FoldingModel(RoomyModel):
    """Turned about x until joint 4 is at 0, where it is singular: half its square is still left."""

    def jacobian(self, joints: np.ndarray) -> np.ndarray:
        jacobian = np.eye(6)
        jacobian[3, 3] = joints[3]
        return jacobian


def test_a_turn_towards_a_singularity_ends_before_it() -> None:
    def turns(left_rad: float) -> float:
        joints = np.array([0.0, 0.0, 0.0, math.sqrt(2.0 * left_rad), 0.0, 0.0])
        asked = Twist(NOTHING, np.array([-0.02, 0.0, 0.0]))
        return norm(limits(FoldingModel()).limit(asked, MIDDLE, joints, 1.0).twist.angular)

    assert turns(0.018) == 0.0
    assert turns(0.025) > 0.0


def test_shaping_brakes_before_a_state_it_could_not_stop_from() -> None:
    shaper = limits()
    down = Twist(np.array([0, 0, -0.25]), NOTHING)
    height = 0.1
    for _ in range(200):  # without the cap: only the judgement of states is left
        tcp = Tcp(np.array([0.33, 0, height]), MIDDLE.rotation)
        height += shaper.shape(down, tcp, JOINTS, 1 / 120).linear[2] / 120
    assert 0.005 <= height < 0.06


def test_shaping_brakes_before_an_orientation_it_could_not_stop_from() -> None:
    shaper = limits()
    out = Twist(NOTHING, np.array([0, 0.5, 0]))
    rotation = MIDDLE.rotation
    for _ in range(300):  # without the cap, as above
        angular = shaper.shape(out, Tcp(MIDDLE.position, rotation), JOINTS, 1 / 120).angular
        rotation = rotation.turned(times(angular, 1 / 120))
    angle = np.linalg.norm(READY_ROTATION.turn_to(rotation))
    assert np.radians(25) < angle <= np.radians(35) + 1e-9


def test_the_posture_that_is_judged_is_the_reported_one() -> None:
    class Listening(RoomyModel):
        def __init__(self) -> None:
            self.heard: list[np.ndarray] = []

        def jacobian(self, joints: np.ndarray) -> np.ndarray:
            self.heard.append(joints)
            return np.eye(6)

    model = Listening()
    joints = np.linspace(-1, 1, 6)
    limits(model).limit(Twist(np.array([0.1, 0, 0]), NOTHING), MIDDLE, joints, 1.0)
    assert model.heard[0] is joints
    assert 0.0 < np.abs(model.heard[1] - joints).max() < 0.01  # where it is about to go


def test_a_hand_that_goes_or_turns_just_fast_enough_is_told_what_stops_it() -> None:
    on_floor = Tcp(np.array([0.33, 0, 0.005]), MIDDLE.rotation)
    tilted = Tcp(MIDDLE.position, MIDDLE.rotation.turned((0, np.radians(36), 0)))
    for tcp, down, turn, told in (
        (on_floor, 0.005, 0.0, Reason.WORKSPACE),
        (on_floor, 0.004999, 0.01, None),
        (tilted, 0.0, 0.02, Reason.ROTATION_LIMIT),
        (tilted, 0.0, 0.01999, None),
    ):
        asked = Twist(np.array([0, 0, -down]), np.array([0, turn, 0]))
        assert limits().limit(asked, tcp, JOINTS, 1.0).limited_by is told


@pytest.mark.parametrize(("scale", "told"), [(0.021, None), (0.019, Reason.SINGULARITY)])
def test_a_fiftieth_of_the_motion_counts_as_nothing_left(scale: float, told: Reason | None) -> None:
    stiff = limits(StiffModel(0.7 / scale * np.pi / 0.2))
    left = stiff.limit(Twist(np.array([0.2, 0, 0]), NOTHING), MIDDLE, JOINTS, 1.0)
    assert left.joint_scale == pytest.approx(scale)
    assert left.limited_by is told


@pytest.mark.parametrize(("linear", "angular"), [(0.1, 0.0), (0.0, 0.2)])
def test_what_only_moves_or_only_turns_is_not_at_rest_and_brakes(
    linear: float, angular: float
) -> None:
    shaper = limits()
    for _ in range(20):
        shaper.shape(Twist(np.full(3, linear), np.full(3, angular)), MIDDLE, JOINTS, 1 / 120)
    assert not shaper.at_rest
    assert not shaper.used_stop_profile
    shaper.come_to_rest(1 / 120)
    assert not shaper.at_rest
    assert shaper.used_stop_profile


def test_coming_to_rest_ends_at_exactly_zero() -> None:
    shaper = limits()
    for _ in range(30):
        shaper.shape(Twist(np.array([0.1, 0, 0]), np.array([0, 0, 0.2])), MIDDLE, JOINTS, 1 / 120)
    for _ in range(13):
        twist = shaper.come_to_rest(1 / 120)
    assert twist.is_zero
    assert shaper.at_rest


# --- joints ---------------------------------------------------------------------------------------


class Lite6Servo:
    """The Lite 6 as its simulated controller moves it.

    Raises `MotionError` where the controller stops with an error.
    """

    def __init__(self) -> None:
        arm = make_config().arm
        self._tool = offset_from_mm_deg(arm.tcp_offset_mm_deg)
        self.model = Lite6Model(self._tool)
        self.joints = tuple(np.radians(arm.ready_joints_deg).tolist())
        self._servo = TwistServo()
        self._now_ns, self._left_s = 0, 0.0

    @property
    def tcp(self) -> Tcp:
        return Tcp.of(self.model.tcp_pose(np.array(self.joints)))

    def follow(self, twist: Twist, interval_s: float) -> None:
        self._servo.command((*twist.linear, *twist.angular), 0.1, self._now_ns)
        self._left_s += interval_s
        while self._left_s >= CYCLE_S:
            self._left_s -= CYCLE_S
            self._now_ns += round(CYCLE_S * 1e9)
            following = self._servo.step(self.joints, self.model, self._now_ns)
            if following is not None:
                check_motion(self.joints, following, floats(self._tool.position), None, True)
                self.joints = following


def driven(directions: list[tuple[float, ...]], seconds: float, turns: bool) -> Lite6Servo:
    """The arm after a hand at full speed has asked for each direction in turn."""
    arm, config = Lite6Servo(), make_config()
    limits = Limits(config, arm.model, arm.tcp.rotation)
    speed = config.limits.max_rotation_rad_s if turns else config.limits.max_speed_mm_s / 1000
    for direction in directions:
        along = times(direction, speed / (norm(direction) or 1.0))
        wanted = Twist(ZERO, along) if turns else Twist(along, ZERO)
        for _ in range(round(seconds * 120)):
            tcp, joints = arm.tcp, np.array(arm.joints)
            limited = limits.limit(wanted, tcp, joints, 1.0)
            arm.follow(limits.shape(limited.twist, tcp, joints, 1 / 120), 1 / 120)
    return arm


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("up", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("across", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("out", [-1.0, 1.0])
def test_a_hand_at_full_speed_never_drives_the_arm_into_an_error_of_its_controller(
    out: float, across: float, up: float, turns: bool
) -> None:
    driven([(out, across, up), (out, across, 0.3), (0.2, -across, up)], 2.0, turns)


DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


# Along the edge of its reach, what is asked shrinks too late where the motion turns outward.
@example([(0.6, 0.3, -0.9), (0.4, 1.0, 1.0), (0.4, -0.9, 0.7), (-0.6, 0.3, 0.9)], 2.0, False)
@example([(0.4, 0.2, 0.8), (0.8, 0.7, 0.2), (0.1, 0.8, -0.3), (-0.8, -0.1, 0.4)], 2.0, False)
@settings(max_examples=10, deadline=None)
@given(st.lists(DIRECTIONS, min_size=1, max_size=5), st.floats(0.5, 2.5), st.booleans())
def test_no_path_of_the_hand_drives_the_arm_into_an_error_of_its_controller(
    directions: list[tuple[float, ...]], seconds: float, turns: bool
) -> None:
    driven(directions, seconds, turns)


def test_away_from_a_stretched_arm_all_of_the_speed_is_left() -> None:
    arm = driven([(1.0, 0.0, 0.8)], 4.0, turns=False)
    limits = Limits(make_config(), arm.model, arm.tcp.rotation)
    joints = np.array(arm.joints)
    further = limits.limit(Twist((0.1, 0.0, 0.1), ZERO), arm.tcp, joints, 1.0)
    assert further.joint_scale < 0.1
    back = limits.limit(Twist((-0.1, 0.0, -0.1), ZERO), arm.tcp, joints, 1.0)
    assert norm(back.twist.linear) > 0.05


def test_a_wrist_that_passes_its_straight_pose_does_not_stop_the_arm() -> None:
    """There it is singular, but this motion asks nothing of the joints that would be too fast."""
    arm = driven([(0.0, 0.0, -1.0), (-1.0, 0.15, 0.0)], 4.0, turns=False)
    assert arm.tcp.position[0] < 0.155  # the box ends at .15


def test_a_joint_comes_to_rest_before_its_limit_and_may_leave_it() -> None:
    class Turning(RoomyModel):
        joint_ranges = ((-0.5, 0.5), *RoomyModel.joint_ranges[1:])

    held = limits(Turning())
    wanted = Twist((0.2, 0.0, 0.0), ZERO)  # joint 1 turns 1 rad a metre
    joints, at = np.zeros(6), []
    for _ in range(1200):
        limited = held.limit(wanted, MIDDLE, joints, 1.0)
        joints = joints.copy()
        joints[0] += held.shape(limited.twist, MIDDLE, joints, 1 / 120).linear[0] / 120
        at.append(joints[0])
    assert max(at) < 0.5
    assert at[-1] > 0.49
    assert held.limit(Twist((-0.2, 0.0, 0.0), ZERO), MIDDLE, joints, 1.0).joint_scale == 1.0


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_s_limit_scales_by_a_plain_number_that_the_link_can_send(joint: int) -> None:
    config = make_config()
    model = Lite6Model()
    joints = np.radians([0.0, 9.9, 31.8, 0.0, 21.9, 0.0])
    joints[joint] = model.joint_ranges[joint][1] - 0.02
    tcp = Tcp.of(model.tcp_pose(joints))
    limits = Limits(config, model, tcp.rotation)
    for twist in (Twist((0.1, 0.1, 0.0), ZERO), Twist(ZERO, (0.1, 0.2, 0.3))):
        limited = limits.limit(twist, tcp, joints, 1.0)
        assert type(limited.joint_scale) is float
        assert all(type(part) is float for part in (*limited.twist.linear, *limited.twist.angular))


def test_a_stretched_arm_stops_a_few_millimetres_before_it_is_straight() -> None:
    arm = driven([(1.0, 0.0, 0.8)], 6.0, turns=False)
    shoulder, wrist = links(arm.joints)[1][3], links(arm.joints)[3][3]
    straight_m = 0.2 + math.hypot(0.087, 0.2276)  # upper arm and forearm
    assert 0.0015 < straight_m - math.dist(shoulder, wrist) < 0.004


def test_below_the_joints_share_of_their_limit_nothing_brakes() -> None:
    stiff = limits(StiffModel(0.6 * np.pi / 0.2))
    wanted = Twist((0.2, 0.0, 0.0), ZERO)
    for _ in range(60):
        reached = stiff.shape(wanted, MIDDLE, JOINTS, 1 / 120)
        assert not stiff.used_stop_profile
    assert reached.linear[0] == pytest.approx(0.2)


@pytest.mark.parametrize("turns", [False, True])
def test_shaping_brakes_before_a_joint_s_limit_that_it_could_not_stop_from(turns: bool) -> None:
    class Narrow(RoomyModel):
        joint_ranges = ((-0.1, 0.1),) * 6  # of which one turns as fast as the hand asks

    shaper, joints = limits(Narrow()), np.zeros(6)
    wanted = Twist(ZERO, (0.3, 0.0, 0.0)) if turns else Twist((0.2, 0.0, 0.0), ZERO)
    for _ in range(240):  # without the cap: only the judgement of states is left
        twist = shaper.shape(wanted, MIDDLE, joints, 1 / 120)
        joints = joints + np.array((*twist.linear, *twist.angular)) / 120
    assert 0.05 < np.abs(joints).max() < 0.1

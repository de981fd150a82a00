"""What every arm keeps to: the Lite 6's driver over TCP and in this process, and a second arm."""

from __future__ import annotations

import numpy as np
import pytest

from hw.arm import Arm, TcpBoundary
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError
from tams_app.records import Activity, LinkFault, Pose, Twist
from tests.contract.conftest import READY_JOINTS, ArmRig, Lite6Rig

pytestmark = pytest.mark.waiting

LITE6_ONLY = pytest.mark.parametrize("rig", ["tcp", "virtual"], indirect=True)
WINDOWS = 5  # of a speed: the median counts
SIDEWAYS = Twist(np.array([0.0, 0.05, 0.0]), np.zeros(3))


def distance_mm(first: Pose, second: Pose) -> float:
    return float(np.linalg.norm(first.position - second.position)) * 1000.0


def position_of(rig: ArmRig, arm: Arm) -> Pose:
    return rig.next_state(arm).tcp


# --- connecting ---------------------------------------------------------------------------------


def test_before_connecting_nothing_moves_and_nothing_breaks(unconnected: Arm) -> None:
    unconnected.send_twist(SIDEWAYS)
    unconnected.set_gripper(True)
    unconnected.stop()
    assert unconnected.state() is None
    assert "connect" in unconnected.link().failure
    assert unconnected.link().fault is LinkFault.LOST
    with pytest.raises(DeviceError, match="connect"):
        unconnected.enable()


def test_connecting_leaves_the_arm_stopped_where_it_is(rig: ArmRig, arm: Arm) -> None:
    state = rig.next_state(arm)
    assert state.activity is Activity.STOPPED
    assert state.fault is None
    np.testing.assert_allclose(state.joints, READY_JOINTS, atol=1e-6)
    assert arm.link().failure == ""
    assert arm.link().fault is LinkFault.NONE


def test_the_reported_tcp_is_the_tool_centre_point_of_the_configuration(
    rig: ArmRig, arm: Arm
) -> None:
    state = rig.next_state(arm)
    offset = offset_from_mm_deg(ArmConfig().tcp_offset_mm_deg)
    expected = Lite6Model(offset).tcp_pose(state.joints)
    assert distance_mm(state.tcp, expected) < 1e-2
    assert (state.tcp.rotation.inv() * expected.rotation).magnitude() < 1e-5


def test_connecting_to_an_arm_in_an_error_says_what_it_is_and_lets_it_be_cleared(
    rig: ArmRig, unconnected: Arm
) -> None:
    rig.collide()
    with pytest.raises(DeviceError, match=rig.collision):
        unconnected.connect()
    unconnected.clear_errors()
    unconnected.connect()
    assert rig.next_state(unconnected).fault is None


@LITE6_ONLY
def test_connecting_refuses_a_controller_that_only_pretends_to_move(
    rig: Lite6Rig, unconnected: Arm
) -> None:
    with rig.model_lock:
        rig.model.settings.simulation_robot = True
    with pytest.raises(DeviceError, match="simulation mode"):
        unconnected.connect()


def test_closing_twice_is_fine_and_one_may_connect_again(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.1)
    enabled.close()
    enabled.close()
    assert enabled.state() is None
    assert rig.is_stopped()
    enabled.connect()
    enabled.enable()
    before = position_of(rig, enabled)
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(before, position_of(rig, enabled)) > 1.0


# --- the velocity servo -------------------------------------------------------------------------


def test_enabling_does_not_move_the_arm(rig: ArmRig, arm: Arm) -> None:
    before = position_of(rig, arm)
    for _ in range(2):
        arm.enable()
        rig.advance(0.05)
    assert distance_mm(before, position_of(rig, arm)) < 1e-3


def test_a_twist_moves_the_tcp_with_its_velocity(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    sent = enabled.link().sent
    velocities = []
    for _ in range(WINDOWS):
        first = enabled.state()
        rig.stream(enabled, SIDEWAYS, 0.5)
        second = enabled.state()
        assert first is not None
        assert second is not None
        seconds = (second.received_ns - first.received_ns) / 1e9
        velocities.append((second.tcp.position - first.tcp.position) / seconds)
    velocity = np.median(velocities, axis=0)
    np.testing.assert_allclose(velocity, SIDEWAYS.linear, atol=0.015)
    assert abs(velocity[0]) < 1e-3
    assert abs(velocity[2]) < 1e-3
    assert enabled.link().failure == ""
    assert enabled.link().sent > sent


def test_a_twist_turns_the_tcp_about_the_axis_told_in_the_base_frame(
    rig: ArmRig, enabled: Arm
) -> None:
    before, begun_s = rig.next_state(enabled).tcp, rig.elapsed_s()
    rig.stream(enabled, Twist(np.zeros(3), np.array([0.0, 0.0, 0.4])), 0.5)
    after = position_of(rig, enabled)
    turn = (after.rotation * before.rotation.inv()).as_rotvec()
    assert 0.1 < turn[2] < 0.4 * (rig.elapsed_s() - begun_s)
    np.testing.assert_allclose(turn[:2], 0.0, atol=1e-3)
    assert distance_mm(before, after) < 0.1


def test_the_arm_stops_by_itself_when_commands_cease(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.3)
    rig.advance(ArmConfig().velocity_deadman_s + 0.2)
    at_rest = position_of(rig, enabled)
    rig.advance(0.2)
    np.testing.assert_array_equal(position_of(rig, enabled).position, at_rest.position)
    assert enabled.link().failure == ""


def test_a_zero_twist_holds_the_arm_exactly_where_it_is(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    rig.stream(enabled, Twist.zero(), 0.3)
    at_rest = position_of(rig, enabled)
    rig.stream(enabled, Twist.zero(), 0.3)
    np.testing.assert_array_equal(position_of(rig, enabled).position, at_rest.position)


def test_a_twist_that_no_arm_may_follow_is_refused_and_nothing_moves_until_enabled_again(
    rig: ArmRig, enabled: Arm
) -> None:
    before = position_of(rig, enabled)
    for impossible in (
        Twist(np.array([0.0, np.nan, 0.0]), np.zeros(3)),
        Twist(np.array([0.0, 0.6, 0.0]), np.zeros(3)),
        Twist(np.zeros(3), np.array([0.0, 0.0, 4.0])),
    ):
        enabled.send_twist(impossible)
        assert rig.until(lambda: "refused" in enabled.link().failure)
        assert enabled.link().fault is LinkFault.REFUSED
        rig.stream(enabled, SIDEWAYS, 0.1)
        assert distance_mm(before, position_of(rig, enabled)) < 1e-3
        enabled.enable()
        assert enabled.link().failure == ""
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(before, position_of(rig, enabled)) > 1.0


# --- going somewhere ----------------------------------------------------------------------------


def test_moving_to_joints_arrives_and_leaves_no_servo_enabled(rig: ArmRig, arm: Arm) -> None:
    goal = READY_JOINTS + np.radians([6.0, -4.0, -4.0, 3.0, 5.0, -6.0])
    arm.begin_move_to_joints(goal.tolist(), 0.8)

    def arrived() -> bool:
        state = rig.next_state(arm)
        return state.activity is Activity.IDLE and float(np.abs(state.joints - goal).max()) < 0.002

    assert rig.until(arrived)
    assert rig.next_state(arm).servo is None
    sent = arm.link().sent
    rig.stream(arm, SIDEWAYS, 0.1)
    assert arm.link().sent == sent


def test_a_move_to_joints_keeps_its_speed(rig: ArmRig, arm: Arm) -> None:
    goal = READY_JOINTS + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    arm.begin_move_to_joints(goal.tolist(), 0.2)
    rig.advance(0.5)
    speeds = []
    for _ in range(WINDOWS):
        first = rig.next_state(arm)
        rig.advance(0.5)
        second = rig.next_state(arm)
        seconds = (second.received_ns - first.received_ns) / 1e9
        speeds.append((second.joints[0] - first.joints[0]) / seconds)
    assert np.median(speeds) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    ("joints", "speed"),
    [([0.0, 3.0, 0.0, 0.0, 0.0, 0.0], 0.5), ([0.0] * 5, 0.5), ([0.0] * 6, 4.0), ([0.0] * 6, 0.0)],
    ids=["out of reach", "five joints", "too fast", "no speed"],
)
def test_a_move_that_no_arm_may_make_is_refused(
    arm: Arm, joints: list[float], speed: float
) -> None:
    with pytest.raises(DeviceError, match="limits"):
        arm.begin_move_to_joints(joints, speed)


def test_a_move_is_ended_by_a_stop_and_not_taken_up_again(rig: ArmRig, arm: Arm) -> None:
    goal = READY_JOINTS + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    arm.begin_move_to_joints(goal.tolist(), 0.5)
    rig.advance(0.3)
    arm.stop()
    assert rig.until(lambda: rig.next_state(arm).activity is Activity.STOPPED)
    rig.advance(0.3)
    at_rest = rig.next_state(arm).joints
    assert at_rest[0] > 0.01
    arm.enable()
    rig.advance(0.3)
    np.testing.assert_array_equal(rig.next_state(arm).joints, at_rest)


# --- the controller's own boundary --------------------------------------------------------------


@LITE6_ONLY
def test_connecting_sets_the_controllers_own_boundary_outside_the_workspace(
    rig: Lite6Rig, arm: Arm
) -> None:
    settings, limits = rig.model.settings, LimitsConfig()
    margin = ArmConfig().boundary_margin_mm
    assert settings.fence
    np.testing.assert_allclose(settings.boundary.upper_mm, np.array(limits.box_max_mm) + margin)
    np.testing.assert_allclose(settings.boundary.lower_mm, np.array(limits.box_min_mm) - margin)


def test_the_controller_itself_stops_what_leaves_its_boundary(rig: ArmRig, enabled: Arm) -> None:
    height_mm = rig.next_state(enabled).tcp.position[2] * 1000.0
    rig.raise_floor_mm(height_mm - 5.0)  # just below the gripper: no need to travel far
    down = Twist(np.array([0.0, 0.0, -0.05]), np.zeros(3))

    def refused() -> bool:
        enabled.send_twist(down)
        state = enabled.state()
        fault = state.fault if state is not None else None
        return fault is not None and fault.text in enabled.link().failure

    assert rig.until(refused)
    assert enabled.link().fault is LinkFault.REFUSED
    assert position_of(rig, enabled).position[2] * 1000.0 > height_mm - 5.5


@LITE6_ONLY
def test_without_a_boundary_the_controllers_own_is_left_alone(rig: Lite6Rig, arm: Arm) -> None:
    arm.close()
    with rig.model_lock:
        rig.model.settings.boundary = own = TcpBoundary((0, -600, 0), (600, 600, 600))
        rig.model.settings.fence = False
    other = rig.make_arm(boundary=None)
    other.connect()
    other.enable()
    assert not rig.model.settings.fence
    assert rig.model.settings.boundary == own
    other.close()


# --- the gripper --------------------------------------------------------------------------------


def test_gripper_commands_are_done_acknowledged_and_reported(rig: ArmRig, enabled: Arm) -> None:
    assert rig.next_state(enabled).gripper_closed is None
    for closed in (True, False):
        enabled.set_gripper(closed)
        assert rig.until(lambda closed=closed: rig.next_state(enabled).gripper_closed is closed)
        assert rig.gripper_driven() is closed
    rig.advance(0.4)
    assert enabled.link().failure == ""


def test_connecting_reads_the_gripper_back_and_leaves_it_alone(rig: ArmRig, enabled: Arm) -> None:
    enabled.set_gripper(True)
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is True)
    enabled.close()
    enabled.connect()
    assert rig.next_state(enabled).gripper_closed is True
    assert rig.gripper_driven() is True


def test_a_gripper_command_that_is_refused_is_a_gripper_fault(rig: ArmRig, enabled: Arm) -> None:
    sent = enabled.link().sent
    rig.spoil_gripper("refuses")
    enabled.set_gripper(True)
    assert rig.until(lambda: enabled.link().fault is LinkFault.GRIPPER)
    assert enabled.link().failure
    assert enabled.link().sent == sent + rig.gripper_attempts
    assert rig.next_state(enabled).gripper_closed is None


def test_outputs_that_differ_from_the_command_are_a_gripper_fault(
    rig: ArmRig, enabled: Arm
) -> None:
    rig.spoil_gripper("ignores")
    enabled.set_gripper(True)
    assert rig.until(lambda: enabled.link().fault is LinkFault.GRIPPER)
    assert "outputs" in enabled.link().failure
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is None)


def test_enabling_anew_ends_a_gripper_fault(rig: ArmRig, enabled: Arm) -> None:
    rig.spoil_gripper("refuses")
    enabled.set_gripper(True)
    assert rig.until(lambda: enabled.link().fault is LinkFault.GRIPPER)
    rig.mend_gripper()
    enabled.clear_errors()
    assert enabled.link().fault is LinkFault.NONE
    enabled.enable()
    enabled.set_gripper(True)
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is True)


# --- stopping and errors ------------------------------------------------------------------------


def test_stop_stops_and_nothing_moves_until_enabled(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    enabled.stop()
    enabled.stop()
    assert rig.until(lambda: rig.next_state(enabled).activity is Activity.STOPPED)
    rig.advance(0.2)
    at_rest = position_of(rig, enabled)
    sent = enabled.link().sent
    rig.stream(enabled, SIDEWAYS, 0.2)
    enabled.set_gripper(True)
    rig.advance(0.1)
    np.testing.assert_array_equal(position_of(rig, enabled).position, at_rest.position)
    assert rig.next_state(enabled).gripper_closed is None
    assert enabled.link().sent == sent
    assert enabled.link().failure == ""
    enabled.enable()
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(at_rest, position_of(rig, enabled)) > 1.0


def test_an_error_shows_in_state_and_link_with_its_code(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.1)
    rig.collide()
    assert rig.until(lambda: rig.next_state(enabled).fault is not None)
    rig.stream(enabled, SIDEWAYS, 0.1)
    assert rig.until(lambda: rig.collision in enabled.link().failure)
    assert enabled.link().fault is LinkFault.REFUSED
    with pytest.raises(DeviceError, match=rig.collision):
        enabled.enable()


def test_clearing_errors_leaves_the_arm_stopped(rig: ArmRig, enabled: Arm) -> None:
    rig.collide()
    rig.stream(enabled, SIDEWAYS, 0.1)
    assert rig.until(lambda: rig.next_state(enabled).fault is not None)
    before = position_of(rig, enabled)
    enabled.clear_errors()
    state = rig.next_state(enabled)
    assert state.fault is None
    assert state.activity is Activity.STOPPED
    assert enabled.link().failure == ""
    assert enabled.link().fault is LinkFault.NONE
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(before, position_of(rig, enabled)) < 1e-3
    enabled.enable()
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(before, position_of(rig, enabled)) > 1.0


def test_a_pressed_emergency_stop_cannot_be_cleared(rig: ArmRig, enabled: Arm) -> None:
    rig.press_emergency_stop()
    assert rig.until(lambda: rig.next_state(enabled).fault is not None)
    with pytest.raises(DeviceError, match="release the emergency stop"):
        enabled.clear_errors()
    rig.press_emergency_stop(False)
    enabled.clear_errors()
    enabled.enable()


def test_frozen_reports_show_as_a_state_that_ages(rig: ArmRig, enabled: Arm) -> None:
    rig.next_state(enabled)
    rig.freeze_reports()
    rig.stream(enabled, Twist.zero(), 0.1)
    frozen = enabled.state()
    rig.stream(enabled, Twist.zero(), 0.3)
    later = enabled.state()
    assert frozen is not None
    assert later is not None
    assert later.received_ns == frozen.received_ns
    assert enabled.link().failure == ""

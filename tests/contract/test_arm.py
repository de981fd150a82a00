"""What every arm keeps to: the Lite 6's driver over TCP and in this process, and a second arm.

On a real arm these are real moves, without deadman or guard: they need half a metre of free space
around it, and a hand on the emergency stop.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from hw.arm import Arm, TcpBoundary
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError
from tams_app.records import Activity, LinkFault, Pose, Twist
from tests.contract.conftest import BOUNDARY, ArmRig, Lite6Rig, raised

pytestmark = pytest.mark.waiting

ONE_LINE = r"\A.+\Z"
SIDEWAYS = Twist((0.0, 0.05, 0.0), (0.0, 0.0, 0.0))
TURN_RAD_S = 0.4
FAR_RAD = np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
WINDOWS = 5  # of a speed: the median counts
BEYOND = 1.2  # times what it can do
LITE6_ONLY = pytest.mark.parametrize("rig", ["tcp", "virtual"], indirect=True)


def distance_mm(first: Pose, second: Pose) -> float:
    """The distance between two places of the TCP."""
    return float(np.linalg.norm(first.position - second.position)) * 1000.0


def moves(rig: ArmRig, arm: Arm, before: Pose) -> bool:
    """A twist moves it from `before`."""
    rig.stream(arm, SIDEWAYS, 0.2)
    return distance_mm(before, rig.next_state(arm).tcp) > 1.0


def stands(rig: ArmRig, arm: Arm, before: Pose) -> bool:
    """It is still where it was; nothing trembles here."""
    return distance_mm(before, rig.next_state(arm).tcp) < rig.rest_mm


# --- connecting ---------------------------------------------------------------------------------


def test_before_connecting_nothing_moves_and_nothing_breaks(unconnected: Arm) -> None:
    unconnected.send_twist(SIDEWAYS)
    unconnected.set_gripper(True)
    unconnected.stop()
    assert unconnected.state() is None
    assert unconnected.link().failure != ""
    assert unconnected.link().fault is LinkFault.LOST
    with pytest.raises(DeviceError, match=ONE_LINE):
        unconnected.enable()


def test_connecting_leaves_the_arm_stopped_where_it_is(rig: ArmRig, arm: Arm) -> None:
    state, link = rig.next_state(arm), arm.link()
    assert state.activity is Activity.STOPPED
    assert state.fault is None
    assert np.abs(state.joints - rig.ready_joints).max() < rig.rest_rad
    assert (link.failure, link.fault) == ("", LinkFault.NONE)


def test_closing_twice_is_fine_and_one_may_connect_again(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.1)
    enabled.close()
    enabled.close()
    assert enabled.state() is None
    enabled.connect()
    enabled.enable()
    assert moves(rig, enabled, rig.next_state(enabled).tcp)


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


def test_closing_stops_the_controller_itself(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.1)
    enabled.close()
    assert rig.is_stopped()


# --- velocities ---------------------------------------------------------------------------------


def test_enabling_does_not_move_the_arm(rig: ArmRig, arm: Arm) -> None:
    before = rig.next_state(arm).tcp
    for _ in range(2):
        arm.enable()
        rig.advance(0.05)
    assert stands(rig, arm, before)


def test_a_twist_moves_the_tcp_with_its_velocity(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    sent, velocities = enabled.link().sent, []
    for _ in range(WINDOWS):
        first = rig.next_state(enabled, reports=0)
        rig.stream(enabled, SIDEWAYS, 0.5)
        second = rig.next_state(enabled, reports=0)
        seconds = (second.received_ns - first.received_ns) / 1e9
        velocities.append((second.tcp.position - first.tcp.position) / seconds)
    off = np.median(velocities, axis=0) - SIDEWAYS.linear
    assert np.abs(off).max() < 0.015
    assert np.abs(off[[0, 2]]).max() < 1e-3, "it goes elsewhere"
    assert enabled.link().failure == ""
    assert enabled.link().sent > sent


def test_a_twist_turns_the_tcp_about_its_axis_in_the_base_frame(rig: ArmRig, enabled: Arm) -> None:
    before, begun_s = rig.next_state(enabled).tcp, rig.elapsed_s()
    rig.stream(enabled, Twist((0.0, 0.0, 0.0), (0.0, 0.0, TURN_RAD_S)), 0.5)
    after = rig.next_state(enabled).tcp
    x, y, z = (after.rotation * before.rotation.inv()).as_rotvec()
    assert 0.1 < z < TURN_RAD_S * (rig.elapsed_s() - begun_s)
    assert math.hypot(x, y) < 1e-3
    assert distance_mm(before, after) < 0.1


def test_the_arm_stops_by_itself_when_commands_cease(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.3)
    rig.advance(rig.deadman_s + 0.2)
    at_rest = rig.next_state(enabled).tcp
    rig.advance(0.2)
    assert stands(rig, enabled, at_rest)
    assert enabled.link().failure == ""


def test_a_zero_twist_holds_the_arm_where_it_is(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    rig.stream(enabled, Twist.zero(), 0.3)
    at_rest = rig.next_state(enabled).tcp
    rig.stream(enabled, Twist.zero(), 0.3)
    assert stands(rig, enabled, at_rest)


def test_a_twist_that_no_arm_may_follow_is_refused_until_enabled_again(
    rig: ArmRig, enabled: Arm
) -> None:
    before = rig.next_state(enabled).tcp
    too_fast = BEYOND * rig.limits.tcp_speed_mm_s / 1000.0
    turning = BEYOND * rig.limits.joint_speed_rad_s
    for impossible in (
        Twist((0.0, math.nan, 0.0), (0.0, 0.0, 0.0)),
        Twist((0.0, too_fast, 0.0), (0.0, 0.0, 0.0)),
        Twist((0.0, 0.0, 0.0), (0.0, 0.0, turning)),
    ):
        enabled.send_twist(impossible)
        assert rig.until(lambda: enabled.link().fault is LinkFault.REFUSED), impossible
        rig.stream(enabled, SIDEWAYS, 0.1)
        assert stands(rig, enabled, before)
        enabled.enable()
        assert enabled.link().failure == ""
    assert moves(rig, enabled, before)


# --- moves to joints ----------------------------------------------------------------------------


def test_moving_to_joints_arrives_and_leaves_no_servo_enabled(rig: ArmRig, arm: Arm) -> None:
    goal = rig.ready_joints + np.radians([6.0, -4.0, -4.0, 3.0, 5.0, -6.0])
    arm.begin_move_to_joints(goal.tolist(), 0.8)

    def arrived() -> bool:
        state = rig.next_state(arm)
        return state.activity is Activity.IDLE and np.abs(state.joints - goal).max() < 0.002

    assert rig.until(arrived)
    assert rig.next_state(arm).servo is None
    sent = arm.link().sent
    rig.stream(arm, SIDEWAYS, 0.1)
    assert arm.link().sent == sent


def test_a_move_to_joints_keeps_its_speed(rig: ArmRig, arm: Arm) -> None:
    arm.begin_move_to_joints((rig.ready_joints + FAR_RAD).tolist(), 0.2)
    rig.advance(0.5)
    speeds = []
    for _ in range(WINDOWS):
        first = rig.next_state(arm)
        rig.advance(0.5)
        second = rig.next_state(arm)
        seconds = (second.received_ns - first.received_ns) / 1e9
        speeds.append((second.joints[0] - first.joints[0]) / seconds)
    assert abs(np.median(speeds) - 0.2) < 0.05


def test_a_move_that_no_arm_may_make_is_refused(rig: ArmRig, arm: Arm) -> None:
    ready = rig.ready_joints.tolist()
    out_of_reach = [*ready[:1], math.radians(rig.limits.joint_upper_deg[1] + 10.0), *ready[2:]]
    for joints, speed in (
        (out_of_reach, 0.5),
        (ready[:5], 0.5),
        (ready, BEYOND * rig.limits.joint_speed_rad_s),
        (ready, 0.0),
    ):
        with pytest.raises(DeviceError, match=ONE_LINE):
            arm.begin_move_to_joints(joints, speed)


def test_a_move_is_ended_by_a_stop_and_not_taken_up_again(rig: ArmRig, arm: Arm) -> None:
    arm.begin_move_to_joints((rig.ready_joints + FAR_RAD).tolist(), 0.5)
    rig.advance(0.3)
    arm.stop()
    assert rig.until(lambda: rig.next_state(arm).activity is Activity.STOPPED)
    rig.advance(0.3)
    at_rest = rig.next_state(arm)
    arm.enable()
    rig.advance(0.3)
    assert stands(rig, arm, at_rest.tcp)


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


def test_the_controller_itself_stops_what_leaves_its_boundary(rig: ArmRig, arm: Arm) -> None:
    height_mm = rig.next_state(arm).tcp.position[2] * 1000.0
    arm.close()
    # just below the gripper: no need to travel far
    enabled = rig.make_arm(raised(BOUNDARY, height_mm - 5.0))
    enabled.connect()
    enabled.enable()
    down = Twist(np.array([0.0, 0.0, -0.05]), np.zeros(3))

    def refused() -> bool:
        enabled.send_twist(down)
        state = enabled.state()
        fault = state.fault if state is not None else None
        return fault is not None and fault.text in enabled.link().failure

    assert rig.until(refused)
    assert enabled.link().fault is LinkFault.REFUSED
    assert rig.next_state(enabled).tcp.position[2] * 1000.0 > height_mm - 5.5
    enabled.close()


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


def test_gripper_commands_are_reported(rig: ArmRig, enabled: Arm) -> None:
    assert rig.next_state(enabled).gripper_closed is None
    for closed in (True, False):
        enabled.set_gripper(closed)
        assert rig.until(lambda c=closed: rig.next_state(enabled).gripper_closed is c)
    rig.advance(0.4)
    assert enabled.link().failure == ""


def test_gripper_commands_are_done(rig: ArmRig, enabled: Arm) -> None:
    for closed in (True, False):
        enabled.set_gripper(closed)
        assert rig.until(lambda closed=closed: rig.gripper_driven() is closed)


def test_connecting_reads_the_gripper_back_and_leaves_it_alone(rig: ArmRig, enabled: Arm) -> None:
    enabled.set_gripper(True)
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is True)
    enabled.close()
    enabled.connect()
    assert rig.next_state(enabled).gripper_closed is True
    assert rig.gripper_driven() is True


def test_a_gripper_command_that_is_refused_is_a_gripper_fault_until_enabled_anew(
    rig: ArmRig, enabled: Arm
) -> None:
    sent = enabled.link().sent
    rig.spoil_gripper("refuses")
    enabled.set_gripper(True)
    assert rig.until(lambda: enabled.link().fault is LinkFault.GRIPPER)
    assert enabled.link().failure
    assert enabled.link().sent == sent + rig.gripper_attempts
    assert rig.next_state(enabled).gripper_closed is None
    rig.mend_gripper()
    enabled.clear_errors()
    assert enabled.link().fault is LinkFault.NONE
    enabled.enable()
    enabled.set_gripper(True)
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is True)


def test_outputs_that_differ_from_the_command_are_a_gripper_fault(
    rig: ArmRig, enabled: Arm
) -> None:
    rig.spoil_gripper("ignores")
    enabled.set_gripper(True)
    assert rig.until(lambda: enabled.link().fault is LinkFault.GRIPPER)
    assert "outputs" in enabled.link().failure
    assert rig.until(lambda: rig.next_state(enabled).gripper_closed is None)


# --- stopping and errors ------------------------------------------------------------------------


def test_stop_stops_and_nothing_moves_until_enabled(rig: ArmRig, enabled: Arm) -> None:
    rig.stream(enabled, SIDEWAYS, 0.2)
    enabled.stop()
    enabled.stop()
    assert rig.until(lambda: rig.next_state(enabled).activity is Activity.STOPPED)
    rig.advance(0.2)
    at_rest, sent = rig.next_state(enabled).tcp, enabled.link().sent
    rig.stream(enabled, SIDEWAYS, 0.2)
    enabled.set_gripper(True)
    rig.advance(0.1)
    assert stands(rig, enabled, at_rest)
    assert rig.next_state(enabled).gripper_closed is None
    assert enabled.link().sent == sent
    assert enabled.link().failure == ""
    enabled.enable()
    assert moves(rig, enabled, at_rest)


def test_an_error_shows_with_its_code_until_it_is_cleared_which_leaves_the_arm_stopped(
    rig: ArmRig, enabled: Arm
) -> None:
    rig.stream(enabled, SIDEWAYS, 0.1)
    rig.collide()
    assert rig.until(lambda: rig.next_state(enabled).fault is not None)
    rig.stream(enabled, SIDEWAYS, 0.1)
    assert rig.until(lambda: rig.collision in enabled.link().failure)
    assert enabled.link().fault is LinkFault.REFUSED
    with pytest.raises(DeviceError, match=rig.collision):
        enabled.enable()
    before = rig.next_state(enabled).tcp
    enabled.clear_errors()
    state = rig.next_state(enabled)
    assert state.fault is None
    assert state.activity is Activity.STOPPED
    assert enabled.link().failure == ""
    assert enabled.link().fault is LinkFault.NONE
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert stands(rig, enabled, before)
    enabled.enable()
    assert moves(rig, enabled, before)


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

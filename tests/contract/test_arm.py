"""What every arm keeps to: the Lite 6's driver over TCP and in this process, and a second arm."""

from __future__ import annotations

import numpy as np
import pytest

from hw.arm import Arm, TcpBoundary
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError
from tams_app.records import Activity, LinkFault, Twist
from tests.contract.conftest import BOUNDARY, ArmRig, Lite6Rig, raised
from tests.contract.promises.arm import ARM_PROMISES, SIDEWAYS, ArmBench, distance_mm
from tests.contract.promises.promise import Promise

pytestmark = pytest.mark.waiting

LITE6_ONLY = pytest.mark.parametrize("rig", ["tcp", "virtual"], indirect=True)


@pytest.mark.parametrize("promise", ARM_PROMISES, ids=lambda promise: promise.__name__)
def test_every_arm_keeps_what_is_promised(rig: ArmRig, promise: Promise[ArmBench]) -> None:
    promise(rig)


# --- connecting ---------------------------------------------------------------------------------


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
    assert distance_mm(before, rig.next_state(enabled).tcp) < 1e-3
    enabled.enable()
    rig.stream(enabled, SIDEWAYS, 0.2)
    assert distance_mm(before, rig.next_state(enabled).tcp) > 1.0


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

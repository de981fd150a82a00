"""Report frames, read back with the SDK's own parser."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from xarm.x3.report import ReportDataStructure

from hw.arm import TcpBoundary
from hw.lite6.codes import Mode
from hw.lite6.kinematics import HOME_JOINTS, rotation_from_rpy, rotation_matrix
from hw.sim.controller.model import ControllerModel, IdealPlant, ReportKind

pytestmark = pytest.mark.untimed

SDK_PORTS = {ReportKind.NORMAL: 30001, ReportKind.RICH: 30002, ReportKind.REAL: 30003}
BYTES = {ReportKind.NORMAL: 145, ReportKind.RICH: 587, ReportKind.REAL: 87}


def busy_model() -> ControllerModel:
    """A model in which every reported number differs from its default."""
    model = ControllerModel(IdealPlant())
    model.set_tcp_offset((1.0, 2.0, 82.0, 0.1, 0.2, 0.3))
    model.settings.load = (0.35, 1.0, 2.0, 40.0)
    model.settings.collision_sensitivity = 4
    model.settings.fence = True
    model.settings.simulation_robot = True
    model.settings.boundary = TcpBoundary((151, -301, 11), (401, 301, 501))
    model.enable(True)
    model.set_mode(Mode.POSITION)
    model.set_state(0)
    model.raise_warning(14)
    model.move_joints(HOME_JOINTS + 0.3, 1.0, 10.0)
    for cycle in range(1, 60):
        model.step(cycle * 4_000_000)
    return model


def parsed(kind: ReportKind, model: ControllerModel) -> Any:
    frame = model.report(kind)
    assert len(frame) == BYTES[kind]
    assert struct.unpack_from(">I", frame)[0] == len(frame)
    structure = ReportDataStructure.create(SDK_PORTS[kind], is_radian=True)
    structure.update(frame)
    return structure


@pytest.mark.parametrize("kind", list(ReportKind))
def test_every_report_tells_where_the_arm_is_and_what_it_does(kind: ReportKind) -> None:
    model = busy_model()
    report = parsed(kind, model)
    assert (report.mode, report.state, report.cmd_num) == (0, 1, 1)
    np.testing.assert_allclose(report.actual_joint_angle[:6], model.joints, atol=1e-6)
    np.testing.assert_allclose(report.actual_tcp_pose[:3], model.tcp[:3, 3] * 1000, atol=1e-3)


@pytest.mark.parametrize("kind", [ReportKind.NORMAL, ReportKind.RICH])
def test_slow_reports_tell_errors_and_configuration(kind: ReportKind) -> None:
    model = busy_model()
    report = parsed(kind, model)
    assert (report.error_code, report.warn_code) == (0, 14)
    assert report.motor_enable_status == 0xFF
    np.testing.assert_allclose(report.tcp_offset, [1, 2, 82, 0.1, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(report.tcp_payload, [0.35, 1, 2, 40], atol=1e-6)
    assert (report.collision_sens, report.gravity_direction) == (4, [0, 0, -1])
    model.raise_error(31)
    assert parsed(kind, model).error_code == 31


def test_the_rich_report_tells_identity_limits_and_safety() -> None:
    model = busy_model()
    report = parsed(ReportKind.RICH, model)
    assert (report.robot_type, report.robot_axis) == (9, 6)
    assert report.version.startswith("6,9,LI")
    assert (report.tcp_max_acc, report.tcp_max_speed) == (50_000, 500)
    assert report.joint_max_speed == pytest.approx(np.pi)
    assert report.is_simulation_robot
    assert report.is_collision_detection
    assert report.is_fence_mode
    assert not report.is_collision_rebound
    assert not report.is_reduced_mode
    assert report.reduced_tcp_boundary == [[151, 401], [-301, 301], [11, 501]]
    np.testing.assert_allclose(report.reduced_joint_limits[2], [-0.0611, 5.236], atol=1e-3)
    np.testing.assert_allclose(report.target_joint_speed[:6], model.joint_speeds, atol=1e-6)
    assert report.target_tcp_speed > 10
    assert report.temperatures == [30] * 6 + [0]
    assert report.joint_voltages == [4800] * 7


def test_the_rich_report_s_axis_and_angle_agree_with_its_roll_pitch_yaw() -> None:
    report = parsed(ReportKind.RICH, busy_model())
    by_rpy = rotation_from_rpy(report.actual_tcp_pose[3:]).as_matrix()
    np.testing.assert_allclose(rotation_matrix(np.array(report.axis_angle)), by_rpy, atol=1e-5)

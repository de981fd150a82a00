"""The controller box through its registers, and its reports read with the SDK's own parser."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from xarm.x3.report import ReportDataStructure

from hw.arm import PlantState, TcpBoundary
from hw.lite6.kinematics import (
    HOME_JOINTS,
    Lite6Model,
    offset_from_mm_deg,
    rotation_from_rpy,
    rotation_matrix,
)
from hw.lite6.protocol import ErrorCode, Mode, Register, ReplyBit, State
from hw.sim.controller.model import CYCLE_NS, ControllerModel, IdealPlant, ReportKind
from tams_app.records import Vector
from tams_app.vectors import Joints, plain

pytestmark = pytest.mark.untimed

READY = np.radians([0, 36.81, 86.74, 0, 49.93, 0])
REFUSED = ReplyBit.NOT_READY | ReplyBit.ERROR | ReplyBit.INVALID
OFFSET_MM_RAD = (0.0, 0.0, 82.0, 0.0, 0.0, 0.0)
TCP = Lite6Model(offset_from_mm_deg((0, 0, 82, 0, 0, 0)))


class LaggingPlant:
    """Joints that lag two thirds of a cycle behind, and can be told to collide."""

    def __init__(self) -> None:
        self.joints = READY.copy()
        self.collision = False
        self.closing: bool | None = None
        self.cycles = 0

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        assert duration_ns == CYCLE_NS
        self.joints = self.joints + (joints_target - self.joints) / 3.0
        self.closing = closing
        self.cycles += 1
        return PlantState(plain(self.joints), self.collision)


class Rig:
    """A model in the ready pose and a clock."""

    def __init__(self) -> None:
        self.plant = LaggingPlant()
        self.model = ControllerModel(self.plant, READY)
        self.now_ns = 1_000_000_000

    def ask(self, register: int, payload: bytes = b"") -> tuple[int, bytes]:
        """Status and data."""
        reply = self.model.handle(register, payload, self.now_ns)
        return reply[0], reply[1:]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 250)):
            self.now_ns += CYCLE_NS
            self.model.step(self.now_ns)

    def arm(self, mode: Mode) -> None:
        self.ask(Register.SET_TCP_OFFSET, struct.pack("<6f", *OFFSET_MM_RAD))
        self.ask(Register.MOTION_ENABLE, bytes([8, 1]))
        self.ask(Register.SET_MODE, bytes([mode]))
        status, _ = self.ask(Register.SET_STATE, bytes([0]))
        assert status == 0

    def velocity(self, vx: float, vy: float, vz: float, duration_s: float = 0.1) -> int:
        """[mm/s]; the status of the reply."""
        payload = struct.pack("<6f", vx, vy, vz, 0, 0, 0) + bytes(1) + struct.pack("<f", duration_s)
        return self.ask(Register.SET_CARTESIAN_VELOCITY, payload)[0]

    def move(self, joints: Vector, speed: float = 1.0) -> int:
        payload = struct.pack("<10f", *joints, 0, speed, 10.0, 0)
        return self.ask(Register.MOVE_JOINT, payload)[0]

    @property
    def position_mm(self) -> Vector:
        position: Vector = self.model.tcp[:3, 3] * 1000
        return position


@pytest.fixture
def rig() -> Rig:
    return Rig()


# --- states -------------------------------------------------------------------------------------


def test_power_on_is_stopped_and_refuses_to_move(rig: Rig) -> None:
    assert rig.model.state is State.STOPPED
    assert rig.move(HOME_JOINTS) & ReplyBit.NOT_READY
    rig.run(0.5)
    np.testing.assert_allclose(rig.model.joints, READY, atol=1e-6)


def test_being_ready_takes_enabling(rig: Rig) -> None:
    rig.ask(Register.SET_STATE, bytes([0]))
    assert not rig.model.ready
    rig.arm(Mode.POSITION)
    assert rig.model.state is State.STANDBY


def test_disabling_stops(rig: Rig) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.velocity(0, 100, 0, 0.0)
    rig.run(0.2)
    rig.ask(Register.MOTION_ENABLE, bytes([8, 0]))
    rig.run(0.3)
    assert rig.model.state is State.STOPPED
    assert not any(rig.model.joint_speeds)


@pytest.mark.parametrize(
    ("register", "payload"),
    [
        (Register.SET_MODE, bytes([5])),
        (Register.SET_TCP_OFFSET, struct.pack("<6f", *OFFSET_MM_RAD)),
        (Register.SET_LOAD, struct.pack("<4f", 0.35, 0, 0, 40)),
        (Register.SET_COLLISION_SENSITIVITY, bytes([3])),
    ],
)
def test_a_change_of_configuration_needs_the_ready_state_again(
    rig: Rig, register: Register, payload: bytes
) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.ask(register, payload)
    assert rig.model.state is State.CHANGED
    assert rig.velocity(0, 50, 0) & ReplyBit.NOT_READY
    rig.run(0.1)
    assert not rig.model.moving
    rig.ask(Register.SET_STATE, bytes([0]))
    assert rig.velocity(0, 50, 0) == 0


def test_a_load_is_acknowledged_as_ready_if_it_was_given_while_ready(rig: Rig) -> None:
    load = struct.pack("<4f", 0.35, 0, 0, 40)
    assert rig.ask(Register.SET_LOAD, load)[0] & ReplyBit.NOT_READY
    rig.arm(Mode.POSITION)
    assert rig.ask(Register.SET_LOAD, load)[0] == 0
    assert rig.model.settings.load == pytest.approx((0.35, 0, 0, 40))


def test_being_made_ready_while_still_braking_does_not_stop_with_a_jerk(rig: Rig) -> None:
    rig.arm(Mode.POSITION)
    rig.move(HOME_JOINTS, speed=2.0)
    rig.run(0.3)
    fast = np.abs(rig.model.joint_speeds).max()
    rig.ask(Register.SET_STATE, bytes([4]))
    rig.ask(Register.SET_STATE, bytes([0]))
    rig.run(0.004)
    assert 0 < np.abs(rig.model.joint_speeds).max() < fast
    assert rig.model.state is State.MOVING
    rig.run(0.3)
    assert rig.model.state is State.STANDBY


def test_a_paused_move_goes_on_and_arrives(rig: Rig) -> None:
    rig.arm(Mode.POSITION)
    rig.move(HOME_JOINTS)
    rig.run(0.3)
    rig.ask(Register.SET_STATE, bytes([3]))
    rig.run(0.3)
    assert rig.model.state is State.PAUSED
    paused_at = rig.model.joints
    rig.run(0.3)
    np.testing.assert_allclose(rig.model.joints, paused_at, atol=1e-6)
    rig.ask(Register.SET_STATE, bytes([0]))
    rig.run(3.0)
    np.testing.assert_allclose(rig.model.joints, HOME_JOINTS, atol=1e-5)
    assert rig.model.state is State.STANDBY


# --- motion -------------------------------------------------------------------------------------


@pytest.mark.parametrize("duration_s", [0.0, -1.0])
def test_velocity_without_a_deadman_time_goes_on_for_ever(rig: Rig, duration_s: float) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.velocity(0, 20, 0, duration_s)
    start = rig.position_mm
    rig.run(3.0)
    assert rig.position_mm[1] - start[1] == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_command_of_another_mode_is_refused(rig: Rig, mode: Mode) -> None:
    rig.arm(mode)
    assert bool(rig.move(HOME_JOINTS) & ReplyBit.INVALID) is (mode is not Mode.POSITION)
    rig.arm(mode)
    invalid = rig.velocity(0, 10, 0) & ReplyBit.INVALID
    assert bool(invalid) is (mode is not Mode.CARTESIAN_VELOCITY)
    rig.arm(mode)


def test_reports_show_where_the_joints_are_and_not_where_they_should_be(rig: Rig) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.velocity(0, 200, 0, 0.0)
    rig.run(0.2)
    np.testing.assert_array_equal(rig.model.joints, rig.plant.joints)
    np.testing.assert_allclose(rig.model.tcp, TCP.tcp_matrix(rig.plant.joints))


# --- errors -------------------------------------------------------------------------------------


def trip(rig: Rig, code: ErrorCode) -> None:
    """Provoke `code` by what causes it in the real arm."""
    if code is ErrorCode.EMERGENCY_STOP:
        rig.model.press_emergency_stop()
    elif code is ErrorCode.KINEMATIC:
        rig.model.raise_error(code)
    elif code is ErrorCode.SELF_COLLISION:
        rig.arm(Mode.POSITION)
        rig.move(np.array([0.0, 0.01, 0.03, 0.0, 1.41, 0.0]))
    elif code is ErrorCode.JOINT_LIMIT:
        rig.arm(Mode.POSITION)
        rig.move(READY + np.array([0, 0, 0, 0, 2.0, 0]))
    elif code is ErrorCode.JOINT_OVERSPEED:
        rig.arm(Mode.CARTESIAN_VELOCITY)
        rig.velocity(300, 0, 0, 0.0)
    elif code is ErrorCode.COLLISION:
        rig.arm(Mode.CARTESIAN_VELOCITY)
        rig.plant.collision = True
    elif code is ErrorCode.BOUNDARY:
        x, y, z = (round(float(value)) for value in rig.position_mm)
        box = struct.pack("<6i", x + 20, x - 20, y + 20, y - 20, z + 300, z - 300)
        rig.ask(Register.SET_BOUNDARY, box)
        rig.ask(Register.SET_FENCE, bytes([1]))
        rig.arm(Mode.CARTESIAN_VELOCITY)
        rig.velocity(0, 100, 0, 0.0)
    rig.run(2.5)


@pytest.mark.parametrize("code", list(ErrorCode))
def test_an_error_stops_the_arm_and_refuses_commands_until_cleaned(
    rig: Rig, code: ErrorCode
) -> None:
    trip(rig, code)
    assert rig.model.error_code == code
    assert rig.model.state is State.STOPPED
    assert not any(rig.model.joint_speeds)
    rig.model.raise_error(code + 1)  # the first one stays
    assert rig.ask(Register.GET_ERROR)[1] == bytes([code, 0])
    rig.ask(Register.SET_STATE, bytes([0]))
    assert rig.velocity(0, 0, 0) & (ReplyBit.ERROR | ReplyBit.NOT_READY)
    assert not rig.model.ready

    rig.plant.collision = False
    rig.model.release_emergency_stop()
    rig.ask(Register.CLEAN_ERROR)
    assert rig.model.error_code == 0
    assert rig.model.state is State.STOPPED
    rig.ask(Register.SET_FENCE, bytes([0]))  # the way back from a limit is the operator's
    rig.ask(Register.SET_SELF_COLLISION_CHECK, bytes([0]))
    rig.arm(Mode.POSITION)
    assert rig.move(READY) == 0
    rig.run(5.0)
    np.testing.assert_allclose(rig.model.joints, READY, atol=1e-5)


def test_the_emergency_stop_cannot_be_cleaned_while_it_is_pressed(rig: Rig) -> None:
    rig.arm(Mode.POSITION)
    rig.model.press_emergency_stop()
    rig.ask(Register.CLEAN_ERROR)
    rig.ask(Register.MOTION_ENABLE, bytes([8, 1]))
    assert rig.model.error_code == ErrorCode.EMERGENCY_STOP
    assert not rig.model.enabled


def test_a_collision_lets_go_instead_of_pressing_on(rig: Rig) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.velocity(0, 0, -200, 0.0)
    rig.run(0.2)
    rig.plant.collision = True
    rig.run(0.004)
    met_at = rig.plant.joints.copy()
    rig.run(0.2)
    np.testing.assert_allclose(rig.plant.joints, met_at, atol=1e-9)


def test_without_collision_detection_a_collision_goes_unnoticed(rig: Rig) -> None:
    rig.ask(Register.SET_COLLISION_SENSITIVITY, bytes([0]))
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.plant.collision = True
    rig.run(0.1)
    assert rig.model.error_code == 0


def test_the_fence_holds_only_while_it_is_on(rig: Rig) -> None:
    trip(rig, ErrorCode.BOUNDARY)
    overrun = rig.position_mm[1] - 20
    assert -1 < overrun < 5
    rig.ask(Register.SET_FENCE, bytes([0]))
    rig.ask(Register.CLEAN_ERROR)
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.velocity(0, 100, 0, 0.3)
    rig.run(0.5)
    assert rig.model.error_code == 0
    assert rig.position_mm[1] > 40


def test_a_warning_shows_and_does_not_stop(rig: Rig) -> None:
    rig.arm(Mode.CARTESIAN_VELOCITY)
    rig.model.raise_warning(11)
    assert rig.velocity(0, 10, 0) == ReplyBit.WARNING
    assert rig.ask(Register.GET_ERROR)[1] == bytes([0, 11])
    assert rig.ask(Register.CLEAN_WARNING)[0] == 0


# --- tool and simulation ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outputs", "drive"),
    [(0b01, False), (0b10, True), (0b00, None), (0b11, None)],
)
def test_two_tool_outputs_drive_the_gripper(rig: Rig, outputs: int, drive: bool | None) -> None:
    rig.model.settings.tool_outputs = 0b11 & ~outputs
    payload = struct.pack(">BH", 9, 0x0A15) + struct.pack("<f", 0x0300 | outputs)
    assert rig.ask(Register.TOOL_GPIO_WRITE, payload)[0] & ReplyBit.INVALID == 0
    assert rig.model.settings.closing is drive
    rig.run(0.004)
    assert rig.plant.closing is drive
    read_back = rig.ask(Register.TOOL_GPIO_READ, struct.pack(">BH", 9, 0x0A18))[1]
    assert struct.unpack(">i", read_back)[0] == outputs


def test_a_write_changes_only_the_outputs_it_names(rig: Rig) -> None:
    rig.model.settings.tool_outputs = 0b10
    payload = struct.pack(">BH", 9, 0x0A15) + struct.pack("<f", 0x0101)
    rig.ask(Register.TOOL_GPIO_WRITE, payload)
    assert rig.model.settings.tool_outputs == 0b11


# --- the wire: requests -------------------------------------------------------------------------

NAN_TWIST = struct.pack("<6f", 0, math.nan, 0, 0, 0, 0) + bytes(1) + struct.pack("<f", 0.1)


@given(st.integers(0, 255), st.binary(max_size=80))
@settings(deadline=None, max_examples=300)
def test_no_request_can_crash_the_controller(register: int, payload: bytes) -> None:
    rig = Rig()
    rig.arm(Mode.CARTESIAN_VELOCITY)
    assert len(rig.model.handle(register, payload, rig.now_ns)) >= 1
    rig.run(0.012)
    assert np.isfinite(rig.model.joints).all()


@pytest.mark.parametrize("register", [4, 21, 99, 253, 254])
def test_a_register_that_is_not_modelled_says_so(rig: Rig, register: int) -> None:
    rig.arm(Mode.POSITION)
    assert rig.ask(register, b"\0") == (ReplyBit.INVALID, b"")


@pytest.mark.parametrize(
    ("mode", "register", "payload"),
    [
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<9f", *[0.0] * 9)),
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<10f", *[0.0] * 10)),
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<10f", *[0.0] * 7, math.inf, 1, 0)),
        (Mode.POSITION, Register.SET_COLLISION_SENSITIVITY, bytes([6])),
        (Mode.SERVO, Register.SET_STATE, bytes([9])),
        (Mode.SERVO, Register.SET_MODE, bytes([2])),
        (Mode.POSITION, Register.SET_TCP_OFFSET, struct.pack("<6f", *[math.inf] * 6)),
        (Mode.POSITION, Register.MOTION_ENABLE, bytes([1, 1])),
        (Mode.CARTESIAN_VELOCITY, Register.SET_CARTESIAN_VELOCITY, NAN_TWIST),
        (Mode.CARTESIAN_VELOCITY, Register.SET_CARTESIAN_VELOCITY, struct.pack("<6f", *[1.0] * 6)),
        (
            Mode.CARTESIAN_VELOCITY,
            Register.SET_CARTESIAN_VELOCITY,
            struct.pack("<6f", *[1.0] * 6) + bytes([1]),
        ),
    ],
)
def test_a_command_that_makes_no_sense_is_refused_and_changes_nothing(
    rig: Rig, mode: Mode, register: Register, payload: bytes
) -> None:
    rig.arm(mode)
    assert rig.ask(register, payload)[0] & ReplyBit.INVALID
    rig.run(0.004)
    assert (rig.model.mode, rig.model.state, rig.model.error_code) == (mode, State.STANDBY, 0)
    np.testing.assert_allclose(rig.model.joints, READY, atol=1e-12)


def test_the_version_text_ends_within_forty_bytes() -> None:
    text = ControllerModel(IdealPlant(), firmware="1.7.3").handle(Register.GET_VERSION, b"", 0)[1:]
    assert len(text) == 40
    assert text[:39].rstrip(b"\0").endswith(b"v1.7.3")
    assert text[39] == 0


# --- the wire: reports --------------------------------------------------------------------------

SDK_PORTS = {ReportKind.RICH: 30002, ReportKind.REAL: 30003}
BYTES = {ReportKind.RICH: 587, ReportKind.REAL: 87}


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


def test_the_rich_report_tells_errors_and_configuration() -> None:
    model = busy_model()
    report = parsed(ReportKind.RICH, model)
    assert (report.error_code, report.warn_code) == (0, 14)
    assert report.motor_enable_status == 0xFF
    np.testing.assert_allclose(report.tcp_offset, [1, 2, 82, 0.1, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(report.tcp_payload, [0.35, 1, 2, 40], atol=1e-6)
    assert (report.collision_sens, report.gravity_direction) == (4, [0, 0, -1])
    model.raise_error(31)
    assert parsed(ReportKind.RICH, model).error_code == 31


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

"""The wire format of the registers, and that nonsense changes nothing."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.lite6.codes import Mode, Register, ReplyBit
from hw.lite6.kinematics import HOME_JOINTS
from hw.sim.controller.model import ControllerModel, IdealPlant

pytestmark = pytest.mark.untimed

NAN_TWIST = struct.pack("<6f", 0, math.nan, 0, 0, 0, 0) + bytes(1) + struct.pack("<f", 0.1)


def ready_model(mode: Mode) -> ControllerModel:
    model = ControllerModel(IdealPlant())
    model.enable(True)
    model.set_mode(mode)
    model.set_state(0)
    return model


def ask(model: ControllerModel, register: int, payload: bytes = b"") -> bytes:
    """The data of an answer that must not be refused."""
    reply = model.handle(register, payload, 0)
    assert not reply[0] & ReplyBit.INVALID
    return reply[1:]


@given(st.integers(0, 255), st.binary(max_size=80))
@settings(deadline=None, max_examples=300)
def test_no_request_can_crash_the_controller(register: int, payload: bytes) -> None:
    model = ready_model(Mode.CARTESIAN_VELOCITY)
    reply = model.handle(register, payload, 0)
    assert len(reply) >= 1
    for cycle in range(1, 4):
        model.step(cycle * 4_000_000)
    assert np.isfinite(model.joints).all()


@pytest.mark.parametrize("register", [4, 21, 99, 253, 254])
def test_a_register_that_is_not_modelled_says_so(register: int) -> None:
    reply = ready_model(Mode.POSITION).handle(register, b"\0", 0)
    assert reply == bytes([ReplyBit.INVALID])


@pytest.mark.parametrize(
    ("mode", "register", "payload"),
    [
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<9f", *[0.0] * 9)),
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<10f", *[0.0] * 10)),
        (Mode.POSITION, Register.MOVE_JOINT, struct.pack("<10f", *[0.0] * 7, math.inf, 1, 0)),
        (Mode.POSITION, Register.SET_COLLISION_SENSITIVITY, bytes([6])),
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
    mode: Mode, register: Register, payload: bytes
) -> None:
    model = ready_model(mode)
    state = model.state
    assert model.handle(register, payload, 0)[0] & ReplyBit.INVALID
    model.step(4_000_000)
    assert (model.state, model.error_code) == (state, 0)
    np.testing.assert_array_equal(model.joints, HOME_JOINTS)


def test_the_version_text_ends_within_forty_bytes() -> None:
    model = ControllerModel(IdealPlant())
    model.firmware = "1.7.3"
    text = ask(model, Register.GET_VERSION)
    assert len(text) == 40
    assert text[:39].rstrip(b"\0").endswith(b"v1.7.3")
    assert text[39] == 0


def test_joint_states_come_in_as_many_rows_as_asked_for() -> None:
    model = ControllerModel(IdealPlant())
    one = struct.unpack("<7f", ask(model, Register.GET_JOINTS))
    np.testing.assert_allclose(one[:6], HOME_JOINTS, atol=1e-6)
    assert len(ask(model, Register.GET_JOINTS, bytes([3]))) == 3 * 28


def test_both_forms_of_the_pose_name_the_same_place() -> None:
    model = ControllerModel(IdealPlant())
    rpy = struct.unpack("<6f", ask(model, Register.GET_TCP_POSE))
    aa = struct.unpack("<6f", ask(model, Register.GET_TCP_POSE_AA))
    np.testing.assert_allclose(rpy[:3], [200.0, 0.0, 200.1], atol=0.1)
    np.testing.assert_allclose(rpy[:3], aa[:3])
    assert abs(rpy[3]) == pytest.approx(math.pi, abs=1e-3)
    assert np.linalg.norm(aa[3:]) == pytest.approx(math.pi, abs=1e-3)


def test_the_boundary_reads_back_as_it_was_written() -> None:
    model = ControllerModel(IdealPlant())
    ask(model, Register.SET_BOUNDARY, struct.pack("<6i", 400, 150, 300, -300, 500, 10))
    ask(model, Register.SET_FENCE, bytes([1]))
    ask(model, Register.SET_SELF_COLLISION_CHECK, bytes([0]))
    answer = ask(model, Register.GET_REDUCED_STATE)
    assert len(answer) == 79
    assert struct.unpack(">6h", answer[1:13]) == (400, 150, 300, -300, 500, 10)
    assert answer[77:] == bytes([1, 0])
    assert not model.settings.self_collision_check

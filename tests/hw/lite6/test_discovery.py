"""What `doctor --devices` learns of an arm, and that it leaves the arm alone."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import numpy as np
import pytest

import hw.sim.controller.model
from hw.arm import FoundArm
from hw.lite6.arm import Lite6
from hw.lite6.discovery import find_arm
from hw.lite6.protocol import ErrorCode, Register
from hw.sim.controller.model import ReportKind
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.runtime.clock import MonotonicClock
from tests.hw.lite6.controller_rig import ControllerRig, controller

pytestmark = pytest.mark.waiting

QUERIES = {Register.GET_VERSION, Register.GET_STATE, Register.GET_ERROR}


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[ControllerRig]:
    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))
    with controller() as made:
        yield made


def probe(rig: ControllerRig) -> FoundArm:
    return find_arm(rig.config())


def test_an_arm_is_found_with_all_that_it_says_of_itself(rig: ControllerRig) -> None:
    info = probe(rig)
    assert info.problem == ""
    assert info.description == (
        "127.0.0.1: Lite 6 LI1006210001, firmware 2.6.0, stopped, motors at most 30 °C; "
        "connecting replaces its TCP offset, load"
    )


def test_a_moving_arm_goes_on_moving_and_is_asked_only(rig: ControllerRig) -> None:
    asked = set()
    rig.intercept(lambda register, _: asked.add(register))
    rig.make_ready()
    with rig.server.lock:
        rig.model.move_joints(tuple(joint + 1.0 for joint in rig.model.joints), 0.05, 1.0)
    assert ", moving," in probe(rig).description
    assert asked == QUERIES
    with rig.server.lock:
        assert rig.model.moving
        assert np.isfinite(rig.model.joints).all()


def test_an_error_and_the_simulation_mode_are_told_with_what_to_do(rig: ControllerRig) -> None:
    with rig.server.lock:
        rig.model.raise_error(ErrorCode.COLLISION)
    info = probe(rig)
    assert "C31" in info.description
    assert "run_tams.py home" in info.problem
    with rig.server.lock:
        rig.model.clean_error()
        rig.model.settings.simulation_robot = True
    info = probe(rig)
    assert "simulation mode" in info.description


def test_settings_of_other_programs_are_told_as_connecting_would(rig: ControllerRig) -> None:
    with rig.server.lock:
        rig.model.settings.reduced = (50.0, 0.35)
        rig.model.settings.collision_rebound = True
    info = probe(rig)
    for words in ("reduced mode, at most 50 mm/s", "limits.max_speed_mm_s", "collision rebound"):
        assert words in info.problem
    arm = Lite6(rig.config(), MonotonicClock())
    with pytest.raises(DeviceError) as refused:
        arm.connect()
    assert str(refused.value) == info.problem
    arm.close()


def test_what_connecting_sets_and_what_is_harmless_is_noted_only(rig: ControllerRig) -> None:
    with rig.server.lock:
        settings = rig.model.settings
        settings.collision_sensitivity, settings.self_collision_check = 0, False
        settings.clear_outputs_on_stop = True
        rig.model.temperatures_c = (30, 30, 64, 30, 30, 30)
    info = probe(rig)
    assert info.problem == ""
    assert info.description.endswith(
        "motors at most 64 °C; connecting replaces its TCP offset, load, collision sensitivity, "
        "self-collision check; a stop switches its gripper off"
    )


def test_another_arm_is_told_from_a_lite6(
    rig: ControllerRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        hw.sim.controller.model, "version_text", lambda firmware: f"7,12,A,B,v{firmware}"
    )
    info = probe(rig)
    assert "no Lite 6" in info.problem
    assert "7 axes" in info.description


def test_no_arm_at_the_address_is_one_sentence() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        info = find_arm(ArmConfig(control_port=unused.getsockname()[1]), 0.5)
    assert "No arm answers" in info.description


def test_a_peer_that_says_nothing_is_no_arm() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        info = find_arm(ArmConfig(control_port=silent.getsockname()[1]), 0.1)
    assert "not like an arm" in info.problem


def test_an_arm_without_reports_is_told(rig: ControllerRig) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1] - 1  # the rich report is one above
        info = find_arm(ArmConfig(control_port=rig.server.ports.control, report_port=port))
    assert "no reports" in info.problem


def test_no_thread_is_left_behind(rig: ControllerRig) -> None:
    def ours() -> set[str]:
        names = {thread.name for thread in threading.enumerate()}
        return {name for name in names if not name.startswith("arm-controller-")}

    before = ours()
    probe(rig)
    find_arm(ArmConfig(control_port=1, report_port=2))
    assert ours() == before

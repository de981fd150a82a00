"""Enabling and clearing outside the control loop, and the stops that outdate them."""

import threading

import numpy as np
import pytest

from hw.arm import TcpBoundary
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmState, Pose, ServoMode
from tams_app.robot.arm_gate import ArmGate
from tams_app.rotation import Rotation
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.teleop.safety import Request

pytestmark = pytest.mark.waiting

BOUNDARY = TcpBoundary((240, -220, 0), (460, 220, 400))


class NotedArm:
    """Notes what it is asked; `during` runs in the middle of `enable`."""

    def __init__(self):
        self.calls = []
        self.tcp_m = (0.3, 0.0, 0.2)
        self.during = lambda: None

    def enable(self):
        self.calls.append("enable")
        self.during()

    def state(self):
        if self.tcp_m is None:
            return None
        pose = Pose(np.array(self.tcp_m), Rotation.identity())
        return ArmState(0, np.zeros(6), pose, Activity.IDLE, ServoMode.VELOCITY, None, None)

    def clear_errors(self):
        self.calls.append("clear")

    def stop(self):
        self.calls.append("stop")


@pytest.fixture
def arm():
    return NotedArm()


@pytest.fixture
def notes():
    return []


@pytest.fixture
def gate(arm, notes):
    return ArmGate(arm, BOUNDARY, lambda level, text: notes.append(text))


@pytest.fixture
def enable(gate):
    def asked():
        gate.request(Request.ENABLE)
        gate.serve()

    return asked


def test_enabling_makes_the_arm_ready_until_it_is_stopped(gate, enable, arm):
    enable()
    assert gate.ready
    gate.stop()
    assert not gate.ready
    assert arm.calls == ["enable", "stop"]


@pytest.mark.parametrize("stops_before", [0, 1])
def test_each_stop_outdates_an_enable_that_was_queued_before_it_and_none_that_comes_after(
    gate, enable, arm, stops_before
):
    for _ in range(stops_before):
        gate.stop()
    gate.request(Request.ENABLE)
    gate.stop()
    gate.serve()
    assert arm.calls == ["stop"] * (stops_before + 1)
    assert not gate.ready
    enable()
    assert gate.ready


def test_a_stop_while_enabling_is_repeated_and_leaves_the_arm_not_ready(gate, enable, arm):
    arm.during = gate.stop
    enable()
    assert arm.calls == ["enable", "stop", "stop"]
    assert not gate.ready


def test_a_second_enable_is_left_out_while_the_first_waits(gate, enable, arm):
    gate.request(Request.ENABLE)
    enable()
    gate.serve()
    assert arm.calls == ["enable"]


def test_an_arm_that_refuses_is_noted_and_not_ready(gate, enable, arm, notes):
    def refuse():
        raise DeviceError("the brakes stay on")

    arm.during = refuse
    enable()
    assert notes == ["the brakes stay on"]
    assert not gate.ready
    arm.during = lambda: None
    enable()
    assert gate.ready


def test_a_refusal_of_what_a_stop_has_outdated_is_no_error(gate, enable, arm, notes):
    def stop_and_refuse():
        gate.stop()
        raise DeviceError("stopped meanwhile")

    arm.during = stop_and_refuse
    enable()
    assert notes == []
    assert not gate.ready


def test_an_enable_after_a_stop_is_taken_while_the_one_before_is_under_way(gate, enable, arm):
    def stop_and_ask_again():
        arm.during = lambda: None
        gate.stop()
        gate.request(Request.ENABLE)
        gate.request(Request.ENABLE)

    arm.during = stop_and_ask_again
    enable()
    enable()
    gate.serve()
    assert arm.calls == ["enable", "stop", "stop", "enable"]
    assert gate.ready


def test_what_enables_the_arm_can_be_given(arm, notes):
    gate = ArmGate(
        arm, None, lambda level, text: notes.append(text), lambda: arm.calls.append("move")
    )
    gate.request(Request.ENABLE)
    gate.serve()
    assert arm.calls == ["move"]
    assert gate.ready


def test_clearing_that_hangs_is_asked_for_once_and_keeps_no_enable_out(gate, enable, arm):
    for _ in range(10):
        gate.request(Request.CLEAR_ERRORS)
    enable()
    assert arm.calls == ["clear", "enable"]
    assert gate.ready


def test_a_request_that_found_no_room_can_be_made_again(gate, enable, arm, monkeypatch):
    with monkeypatch.context() as full:
        full.setattr(BoundedQueue, "put", lambda queue, item: False)
        gate.request(Request.ENABLE)
    enable()
    assert gate.ready


def test_clearing_that_failed_can_be_asked_for_again(gate, arm, notes):
    def refuse():
        arm.calls.append("refused")
        raise DeviceError("the emergency stop is pressed")

    clear, arm.clear_errors = arm.clear_errors, refuse
    gate.request(Request.CLEAR_ERRORS)
    gate.serve()
    arm.clear_errors = clear
    gate.request(Request.CLEAR_ERRORS)
    gate.serve()
    assert arm.calls == ["refused", "clear"]
    assert notes[0] == "the emergency stop is pressed"


def test_an_arm_outside_the_workspace_is_not_enabled_until_it_is_inside(gate, enable, arm, notes):
    arm.tcp_m = (0.6, 0.0, 0.118)
    enable()
    assert (arm.calls, gate.ready) == ([], False)
    assert notes == [
        "the TCP is at (600, 0, 118) mm, outside the workspace: run `run_tams.py home` first"
    ]
    arm.tcp_m = (0.3, 0.0, 0.118)
    enable()
    assert (arm.calls, gate.ready) == (["enable"], True)


def test_an_arm_without_a_report_is_enabled_and_held_by_the_loop(enable, arm):
    arm.tcp_m = None
    enable()
    assert arm.calls == ["enable"]


def test_what_was_done_and_what_the_arm_refused_is_noted(arm):
    def refuse():
        raise DeviceError("the brakes stay on")

    noted = []
    gate = ArmGate(arm, BOUNDARY, lambda *note: noted.append(note))
    for during in (lambda: None, refuse):
        arm.during = during
        gate.request(Request.CLEAR_ERRORS)
        gate.request(Request.ENABLE)
        gate.serve()
    cleared = ("info", "arm errors cleared")
    assert noted == [cleared, ("info", "arm enabled"), cleared, ("error", "the brakes stay on")]


def test_the_worker_carries_requests_out_until_its_end_and_waits_for_none_of_them(gate):
    stop, waits = threading.Event(), []

    def serve(wait_s):
        waits.append(wait_s)
        if len(waits) == 3:
            stop.set()

    gate.serve = serve
    gate.run(stop)
    assert len(waits) == 3
    assert all(0.0 < wait_s < 1.0 for wait_s in waits)

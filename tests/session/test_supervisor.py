"""Enabling and clearing outside the control loop, and the stops that outdate them."""

import threading

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw.arm import ServoMode
from hw.boundary import TcpBoundary
from tams_app.errors import DeviceError
from tams_app.records import ArmState, Pose
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.session.supervisor import ArmSupervisor
from tams_app.teleop.safety import Request

pytestmark = pytest.mark.waiting

BOUNDARY = TcpBoundary((240, -220, 0), (460, 220, 400))


class NotedArm:
    """Notes what it is asked; `during` runs in the middle of `enable`."""

    def __init__(self):
        self.calls = []
        self.tcp_m = (0.3, 0.0, 0.2)
        self.during = lambda: None

    def enable(self, servo):
        self.calls.append("enable")
        self.during()

    def state(self):
        if self.tcp_m is None:
            return None
        pose = Pose(np.array(self.tcp_m), Rotation.identity())
        return ArmState(0, np.zeros(6), pose, 5, 2, 0, 0, None)

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
def supervisor(arm, notes):
    return ArmSupervisor(arm, ServoMode.VELOCITY, BOUNDARY, lambda level, text: notes.append(text))


def run_queued(supervisor):
    """Run what is queued, in this thread."""
    stop = threading.Event()
    original = supervisor.carry_out

    def once(request, stops):
        original(request, stops)
        stop.set()

    supervisor.carry_out = once
    timer = threading.Timer(0.3, stop.set)
    timer.start()
    supervisor.run(stop)
    timer.cancel()
    timer.join()
    supervisor.carry_out = original


def test_enabling_makes_the_arm_ready_until_it_is_stopped(supervisor, arm):
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert supervisor.ready
    supervisor.stopped()
    assert not supervisor.ready
    assert arm.calls == ["enable"]


def test_a_stop_outdates_an_enable_that_was_queued_before_it(supervisor, arm):
    supervisor.request(Request.ENABLE)
    supervisor.stopped()
    run_queued(supervisor)
    assert arm.calls == []
    assert not supervisor.ready


def test_a_stop_while_enabling_is_repeated_and_leaves_the_arm_not_ready(supervisor, arm):
    arm.during = supervisor.stopped
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert arm.calls == ["enable", "stop"]
    assert not supervisor.ready


def test_a_second_enable_is_left_out_while_the_first_waits(supervisor, arm):
    supervisor.request(Request.ENABLE)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    run_queued(supervisor)
    assert arm.calls == ["enable"]


def test_after_a_stop_the_arm_can_be_enabled_again(supervisor, arm):
    supervisor.request(Request.ENABLE)
    supervisor.stopped()
    run_queued(supervisor)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert supervisor.ready


def test_an_arm_that_refuses_is_noted_and_not_ready(supervisor, arm, notes):
    def refuse():
        raise DeviceError("the brakes stay on")

    arm.during = refuse
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert notes == ["the brakes stay on"]
    assert not supervisor.ready
    arm.during = lambda: None
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert supervisor.ready


def test_clearing_errors_is_carried_out(supervisor, arm):
    supervisor.request(Request.CLEAR_ERRORS)
    run_queued(supervisor)
    assert arm.calls == ["clear"]
    supervisor.request(Request.CLEAR_ERRORS)
    run_queued(supervisor)
    assert arm.calls == ["clear", "clear"]


def test_clearing_that_hangs_is_asked_for_once_and_keeps_no_enable_out(supervisor, arm):
    for _ in range(10):
        supervisor.request(Request.CLEAR_ERRORS)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert arm.calls == ["clear", "enable"]
    assert supervisor.ready


def test_a_request_that_found_no_room_can_be_made_again(supervisor, arm, monkeypatch):
    with monkeypatch.context() as full:
        full.setattr(BoundedQueue, "put", lambda queue, item: False)
        supervisor.request(Request.ENABLE)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert supervisor.ready


def test_clearing_that_failed_can_be_asked_for_again(supervisor, arm, notes):
    def refuse():
        arm.calls.append("refused")
        raise DeviceError("the emergency stop is pressed")

    clear, arm.clear_errors = arm.clear_errors, refuse
    supervisor.request(Request.CLEAR_ERRORS)
    run_queued(supervisor)
    arm.clear_errors = clear
    supervisor.request(Request.CLEAR_ERRORS)
    run_queued(supervisor)
    assert arm.calls == ["refused", "clear"]
    assert notes[0] == "the emergency stop is pressed"


def test_an_arm_outside_the_workspace_is_not_enabled_until_it_is_inside(supervisor, arm, notes):
    arm.tcp_m = (0.2, 0.0, 0.118)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert (arm.calls, supervisor.ready) == ([], False)
    assert notes == [
        "the TCP is at (200, 0, 118) mm, outside the workspace: run `run_tams.py home` first"
    ]
    arm.tcp_m = (0.3, 0.0, 0.118)
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert (arm.calls, supervisor.ready) == (["enable"], True)


def test_an_arm_without_a_report_is_enabled_and_held_by_the_loop(supervisor, arm):
    arm.tcp_m = None
    supervisor.request(Request.ENABLE)
    run_queued(supervisor)
    assert arm.calls == ["enable"]

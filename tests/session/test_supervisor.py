"""Enabling and clearing outside the control loop, and the stops that outdate them."""

import threading

import pytest

from hw.arm import ServoMode
from tams_app.errors import DeviceError
from tams_app.session.supervisor import ArmSupervisor
from tams_app.teleop.safety import Request


class NotedArm:
    """Notes what it is asked; `during` runs in the middle of `enable`."""

    def __init__(self):
        self.calls = []
        self.during = lambda: None

    def enable(self, servo):
        self.calls.append("enable")
        self.during()

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
    return ArmSupervisor(arm, ServoMode.VELOCITY, lambda level, text: notes.append(text))


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

"""A gateway or its owner that is killed: the other goes on, and notices by the process's end."""

from __future__ import annotations

import time

import psutil
import pytest

from tams_app.link.gateway_client import Endpoint, Gateway
from tests.faults.applications import until

pytestmark = pytest.mark.waiting


def test_what_is_sent_to_a_killed_gateway_is_lost_and_raises_nothing():
    gateway = Gateway("operator", Endpoint("127.0.0.1", 9, None), b"greeting", None)
    gateway.launch()
    try:
        gateway.wait_ready()
        psutil.Process(gateway.process.pid).kill()
        until(lambda: gateway.process.exit_code is not None, "the gateway's end")
        for _ in range(10):  # the kernel tells of it in different ways, one after the other
            gateway.send(b"message")
            assert gateway.receive() == []
            time.sleep(0.001)
    finally:
        gateway.close()


def test_a_gateway_whose_application_is_gone_lives_until_it_can_say_goodbye():
    """The application's end closes first its channel, then the pipe that ends the gateway."""
    robot = Gateway("robot", Endpoint("127.0.0.1", 0, None), b"welcome", None)
    operator: Gateway | None = None
    try:
        robot.launch()
        robot.wait_ready()
        operator = Gateway("operator", Endpoint("127.0.0.1", robot.port, None), b"hello", None)
        operator.launch()
        operator.wait_ready()

        def connected() -> bool:
            operator.send(b"sample")
            return bool(robot.receive()) and robot.event.connected

        until(connected, "the link")
        operator._channel.close()
        for _ in range(20):
            robot.send(b"state")
            time.sleep(0.005)
        assert operator.process.exit_code is None
        operator.close()

        def left() -> bool:
            robot.receive()
            return robot.event.left

        until(left, "the goodbye", within_s=5.0)
    finally:
        for one in (operator, robot):
            if one is not None:
                one.close()

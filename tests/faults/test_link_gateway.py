"""A gateway whose application is killed says goodbye for it."""

from __future__ import annotations

import time

import pytest

from tams_app.link.gateway_client import Endpoint, Gateway
from tests.faults.applications import until

pytestmark = pytest.mark.waiting


def test_a_gateway_whose_application_is_gone_lives_until_it_can_say_goodbye():
    """The application's end closes first its channel, then the pipe that ends the gateway."""
    robot = Gateway("robot", Endpoint("127.0.0.1", 0, None), b"welcome", None)
    operator: Gateway | None = None
    try:
        robot.launch()
        robot.wait_ready()
        operator = Gateway("operator", Endpoint("127.0.0.1", robot.port, None), b"", None)
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

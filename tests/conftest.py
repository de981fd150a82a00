"""What holds for every test."""

import socket

import pytest


@pytest.fixture(autouse=True)
def _no_default_timeout():
    """The xArm SDK sets a time-out for all sockets of the process: no test passes it on."""
    yield
    socket.setdefaulttimeout(None)

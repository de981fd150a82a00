"""The network to the arm fails and comes back: what was sent before must not move it after."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from ctypes import CDLL
from functools import partial

import numpy as np
import pytest

from hw.lite6.arm import Lite6
from hw.lite6.protocol import State
from hw.sim.controller.model import IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig
from tams_app.records import LinkFault, Twist
from tams_app.runtime.clock import MonotonicClock
from tests.faults.wire import TappedModel
from tests.hw.lite6.controller_rig import until
from tests.tcp_relay import TcpRelay

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.usefixtures("real_time"),
]

WITHIN_S = 20.0  # generous: the machine may be busy
SENDING_PERIOD_S = 1 / 120
ACROSS = Twist(np.array([0.0, 0.1, 0.0]), np.zeros(3))
NOWHERE = "02:00:00:00:00:99"  # an address that is not on the cable
HERE_IP, THERE_IP = "10.213.8.1", "10.213.8.2"


def served_model(cleaning: ExitStack, host: str) -> tuple[TappedModel, ControllerServer]:
    joints = np.radians(ArmConfig().ready_joints_deg)
    model = TappedModel(IdealPlant(), start_joints=joints)
    server = ControllerServer(model, host=host)
    server.start()
    cleaning.callback(server.close)
    return model, server


def moving_arm(cleaning: ExitStack, config: ArmConfig) -> Lite6:
    """An arm under way: its last commands were acknowledged."""
    arm = Lite6(config, MonotonicClock())
    cleaning.callback(arm.close)
    arm.connect()
    arm.enable()
    sent = arm.link().sent
    while arm.link().sent < sent + 20:
        assert not arm.link().failure
        arm.send_twist(ACROSS)
        time.sleep(SENDING_PERIOD_S)
    return arm


def send_until_lost(arm: Lite6) -> None:
    """Go on as the control loop does, up to the fault and its stop."""
    deadline_s = time.monotonic() + WITHIN_S
    while not arm.link().failure:
        assert time.monotonic() < deadline_s
        arm.send_twist(ACROSS)
        time.sleep(SENDING_PERIOD_S)
    arm.stop()


# --- over a cable, in network namespaces ----------------------------------------------------------


def ip(*words: str) -> str:
    result = subprocess.run(["ip", *words], capture_output=True, text=True, timeout=10, check=False)
    if result.returncode != 0:
        raise OSError(f"ip {' '.join(words)}: {result.stderr.strip()}")
    return result.stdout


class Cable:
    """Two network namespaces with a cable between them, to be cut without anybody noticing."""

    def __init__(self, cleaning: ExitStack) -> None:
        self._here, self._there = f"tams-c{os.getpid()}", f"tams-d{os.getpid()}"
        here, there = self._here, self._there
        for space in (here, there):
            ip("netns", "add", space)
            cleaning.callback(ip, "netns", "del", space)
        ip(*f"-n {here} link add va type veth peer name vb netns {there}".split())
        for space, end, address in ((here, "va", HERE_IP), (there, "vb", THERE_IP)):
            ip("-n", space, "addr", "add", f"{address}/24", "dev", end)
            ip("-n", space, "link", "set", end, "up")
            ip("-n", space, "link", "set", "lo", "up")
        link = ip("-n", there, "link", "show", "vb").split()
        self._address = link[link.index("link/ether") + 1]
        self.here = self._pool(cleaning, here)
        self.there = self._pool(cleaning, there)
        self.mend()

    def cut(self) -> None:
        """What is sent to the arm is lost; what it sends arrives."""
        self._send_to(NOWHERE)

    def mend(self) -> None:
        self._send_to(self._address)

    def _send_to(self, address: str) -> None:
        words = f"neigh replace {THERE_IP} lladdr {address} nud permanent dev va"
        ip("-n", self._here, *words.split())

    def _pool(self, cleaning: ExitStack, space: str) -> ThreadPoolExecutor:
        """A thread in `space`: its sockets belong there, and those of threads it starts."""
        enter = partial(enter_namespace, f"/run/netns/{space}")
        return cleaning.enter_context(ThreadPoolExecutor(1, initializer=enter))


def enter_namespace(path: str) -> None:
    number = os.open(path, os.O_RDONLY)
    try:
        if CDLL(None, use_errno=True).setns(number, 0) != 0:
            raise OSError(f"{path} cannot be entered")
    finally:
        os.close(number)


@pytest.fixture
def cleaning() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def cable(cleaning: ExitStack) -> Cable:
    if sys.platform != "linux" or os.geteuid() != 0 or not shutil.which("ip"):
        pytest.skip("needs Linux, root and ip")
    try:
        made = Cable(cleaning)
        made.here.submit(socket.gethostbyname, "localhost").result(WITHIN_S)
    except (OSError, RuntimeError) as error:  # RuntimeError: a thread could not enter
        pytest.skip(f"network namespaces are not permitted here: {error}")
    return made


@pytest.mark.parametrize("outage_s", [0.15, 0.5, 1.0])
def test_no_motion_from_before_a_network_outage_reaches_the_arm_after_the_fault(
    cleaning: ExitStack, cable: Cable, outage_s: float
) -> None:
    model, server = cable.there.submit(served_model, cleaning, THERE_IP).result(WITHIN_S)
    ports = server.ports
    config = ArmConfig(host=THERE_IP, control_port=ports.control, report_port=ports.report)
    arm = cable.here.submit(moving_arm, cleaning, config).result(WITHIN_S)
    cut_s = time.monotonic()
    cable.cut()
    before = sum(request.is_motion for request in model.wire)
    send_until_lost(arm)
    assert arm.link().fault is LinkFault.LOST
    time.sleep(max(0.0, cut_s + outage_s - time.monotonic()))
    cable.mend()
    assert until(lambda: model.state == State.STOPPED)
    time.sleep(0.5)  # the kernel repeats what is not acknowledged at growing intervals
    assert sum(request.is_motion for request in model.wire) - before <= 1  # as the cable was cut
    cable.here.submit(arm.clear_errors).result(WITHIN_S)
    assert not arm.link().failure
    arm.enable()


# --- what every machine can show ------------------------------------------------------------------


def relayed_arm(cleaning: ExitStack) -> tuple[TappedModel, TcpRelay, Lite6]:
    """An arm under way, and the relay between it and its controller."""
    model, server = served_model(cleaning, "127.0.0.1")
    relay = TcpRelay(server.ports.control)
    cleaning.callback(relay.close)
    config = ArmConfig(control_port=relay.port, report_port=server.ports.report)
    return model, relay, moving_arm(cleaning, config)


def test_a_lost_command_connection_is_reset_so_that_nothing_it_holds_can_follow(
    cleaning: ExitStack,
) -> None:
    model, relay, arm = relayed_arm(cleaning)
    resets = relay.resets
    relay.hold()
    send_until_lost(arm)
    assert arm.link().fault is LinkFault.LOST
    assert until(lambda: relay.resets > resets)
    relay.pass_on()
    assert until(lambda: model.state == State.STOPPED)


def test_a_command_unanswered_when_the_arm_is_stopped_is_taken_back_too(
    cleaning: ExitStack,
) -> None:
    model, relay, arm = relayed_arm(cleaning)
    resets = relay.resets
    relay.hold()
    sent = arm.link().sent
    assert until(lambda: arm.send_twist(ACROSS) or arm.link().sent > sent)  # type: ignore[func-returns-value]
    arm.stop()
    assert until(lambda: relay.resets > resets)
    assert until(lambda: arm.link().fault is LinkFault.LOST)  # notified after the reset
    relay.pass_on()
    assert until(lambda: model.state == State.STOPPED)
    arm.clear_errors()
    assert not arm.link().failure

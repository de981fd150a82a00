"""Two gateway processes, and the network between them, which records what it carries."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tams_app.link.gateway_client import Endpoint, Gateway

LOOPBACK = "127.0.0.1"
WITHIN_S = 30.0  # generous: the machine may be busy


def udp(stack: ExitStack) -> socket.socket:
    """A port of our own on loopback."""
    one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
    one.bind((LOOPBACK, 0))
    one.settimeout(WITHIN_S)
    return one


def port_of(one: socket.socket) -> int:
    return int(one.getsockname()[1])


class Network:
    """Carries datagrams between an operator's gateway and a robot's; a thread. `recorded`: all."""

    def __init__(self, stack: ExitStack, robot_port: int) -> None:
        self._front, self._back = udp(stack), udp(stack)
        self._robot = (LOOPBACK, robot_port)
        self.operator: tuple[str, int] | None = None  # where it called from last
        self.recorded: list[bytes] = []
        self.port = port_of(self._front)
        self._ended = threading.Event()
        thread = threading.Thread(target=self._carry, daemon=True)
        thread.start()
        stack.callback(thread.join)
        stack.callback(self._ended.set)

    def to_robot(self, datagram: bytes) -> None:
        """A stranger sends this, from the operator's own address."""
        self._back.sendto(datagram, self._robot)

    def to_operator(self, datagram: bytes) -> None:
        """A stranger sends this, from the robot's own address."""
        assert self.operator is not None
        self._front.sendto(datagram, self.operator)

    def _carry(self) -> None:
        while not self._ended.is_set():
            for one in select.select([self._front, self._back], [], [], 0.05)[0]:
                try:
                    datagram, sender = one.recvfrom(65_536)
                except ConnectionRefusedError:  # a gateway has ended
                    continue
                self.recorded.append(datagram)
                if one is self._front:
                    self.operator = sender
                    self._back.sendto(datagram, self._robot)
                elif self.operator is not None:
                    self._front.sendto(datagram, self.operator)


class Pair:
    """A robot's gateway and operators' gateways that call it; messages that came, by gateway."""

    def __init__(self, stack: ExitStack, tmp_path: Path, key: Path | None) -> None:
        self._stack, self._logs = stack, tmp_path
        self.key = key
        self.heard: dict[Gateway, list[bytes]] = {}
        self.robot = self.gateway("robot", 0, key)

    def gateway(self, side: str, port: int, key: Path | None) -> Gateway:
        """A gateway that is ready."""
        logs = self._logs / f"{side}-{len(self.heard)}"
        logs.mkdir(exist_ok=True)  # of one that has ended
        welcome = b"welcome" if side == "robot" else b"from the operator"
        made = Gateway(side, Endpoint(LOOPBACK, port, key), welcome, logs)  # type: ignore[arg-type]
        self._stack.callback(made.close)
        self.heard[made] = []
        made.launch()
        made.wait_ready()
        return made

    def operator(self, port: int | None = None) -> Gateway:
        """An operator's gateway that has a session."""
        made = self.gateway("operator", self.robot.port if port is None else port, self.key)
        self.until(lambda: made.event.connected)
        return made

    def take(self) -> None:
        """Take in what came to all gateways."""
        for gateway, messages in self.heard.items():
            messages += [received.content for received in gateway.receive()]

    def until(self, holds: Callable[[], bool], meanwhile: Callable[[], None] | None = None) -> None:
        """Take in what comes until `holds`."""
        deadline_s = time.monotonic() + WITHIN_S
        while True:
            self.take()
            if holds():
                return
            assert time.monotonic() < deadline_s, [one.event for one in self.heard]
            if meanwhile is not None:
                meanwhile()
            time.sleep(0.005)

    def routed(self, operator: Gateway) -> None:
        """Both sides have taken in where packets are to go: a message that was sent later came."""
        self.passes(operator, self.robot, b"after the routes")
        self.passes(self.robot, operator, b"after the routes")

    def passes(self, sender: Gateway, receiver: Gateway, message: bytes) -> None:
        """Send `message` until it has arrived: a full buffer may lose one."""
        heard = self.heard[receiver]
        self.until(lambda: message in heard[-5:], lambda: sender.send(message))

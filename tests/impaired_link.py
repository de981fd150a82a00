"""The network between the two computers as a process: delay, jitter, cuts, and what else happens.

The operator's side calls this process, which passes every datagram on to the robot's side, and what
comes back to the address that called last. It knows nothing of what it carries. Each way has:

latency_ms, jitter_ms: the delay, and what is added to it at most, 95 times of 100; order is kept.
duplicate, reorder: fractions of the datagrams; one that is reordered is 20 ms later.
passage: `open`; `cut`, which loses everything; `hold`, which keeps it: what was held leaves at
once, in one burst, when it ends.

Beside that the operator's side may change its address (`moves`), and everything that it has ever
sent may be sent again from elsewhere (`replays`); both count how often. `hostile_hz`: so many
datagrams a second that neither side has made reach each of them, from its peer's address or, for
the robot's side, from elsewhere too.
"""

from __future__ import annotations

import heapq
import random
import selectors
import socket
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from tams_app.runtime.process import HelperProcess, HelperSide
from tams_app.runtime.realtime import RELAY_PRIORITY, use_fifo
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import hostile

Passage = Literal["open", "cut", "hold"]
HOST = "127.0.0.1"
_REORDERED_NS = 20 * NS_PER_MS
_SIGMAS_OF_95_PERCENT = 1.96
_LARGEST_BYTES = 65_536
_BUFFER_BYTES = 4_000_000
_POLL_S = 0.002  # what it is told is in force so soon
_KEPT = 100_000


@dataclass(frozen=True, slots=True)
class Conditions:
    """How one way is; see the module."""

    latency_ms: float = 0.0
    jitter_ms: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    passage: Passage = "open"


class Way:
    """The datagrams of one direction; pure."""

    def __init__(self, conditions: Conditions, seed: int) -> None:
        self._conditions = conditions
        self._random = random.Random(seed)
        self._held: list[bytes] = []
        self._due: list[tuple[int, int, bytes]] = []  # (when, number, ...)
        self._number = 0
        self._last_ns = 0

    def becomes(self, conditions: Conditions, now_ns: int) -> None:
        """From now on it is so. A cut loses what is on its way as well."""
        self._conditions = conditions
        if conditions.passage == "cut":
            self._due.clear()
        if conditions.passage != "hold":
            held, self._held = self._held, []
            for datagram in held if conditions.passage == "open" else ():
                self._put(now_ns, datagram)

    def offer(self, now_ns: int, datagram: bytes) -> None:
        """A datagram enters."""
        now = self._conditions
        if now.passage == "hold":
            self._held.append(datagram)
        elif now.passage == "open":
            sigma_ms = now.jitter_ms / _SIGMAS_OF_95_PERCENT
            delay_ms = now.latency_ms + abs(self._random.gauss(0.0, sigma_ms))
            due_ns = now_ns + round(delay_ms * NS_PER_MS)
            if self._random.random() < now.reorder:
                self._put(due_ns + _REORDERED_NS, datagram)
                return
            self._last_ns = due_ns = max(due_ns, self._last_ns)
            self._put(due_ns, datagram)
            if self._random.random() < now.duplicate:
                self._put(due_ns, datagram)

    def due(self, now_ns: int) -> list[bytes]:
        """The datagrams that leave now. On hold none does."""
        if self._conditions.passage == "hold":
            return []
        out = []
        while self._due and self._due[0][0] <= now_ns:
            out.append(heapq.heappop(self._due)[2])
        return out

    @property
    def next_ns(self) -> int | None:
        """When the next one leaves; None if none is on its way."""
        if not self._due or self._conditions.passage == "hold":
            return None
        return self._due[0][0]

    def _put(self, due_ns: int, datagram: bytes) -> None:
        self._number += 1
        heapq.heappush(self._due, (due_ns, self._number, datagram))


class Relay:
    """The sockets, and the loop between them."""

    def __init__(self, robot: tuple[str, int], there: Way, back: Way) -> None:
        self._robot = robot
        self._ways = (there, back)
        self._caller: tuple[str, int] | None = None
        self._kept: list[bytes] = []
        self._kept_back: list[bytes] = []
        self._moves = self._replays = 0
        self._hostile_hz = 0
        self._hostile_since_ns = self._hostile_now = 0  # since it began at this rate
        self.hostile = 0  # so many have reached each side
        self._draw = random.Random(0)
        self._elsewhere = _udp("")
        self._entrance = _udp(HOST)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._entrance, selectors.EVENT_READ)
        self._exit = self._new_exit()

    @property
    def port(self) -> int:
        """What the operator's side must call."""
        return int(self._entrance.getsockname()[1])

    def follow(self, received: Mapping[str, Any]) -> None:
        """How it is from now on."""
        now_ns = time.monotonic_ns()
        for way, name in zip(self._ways, ("there", "back"), strict=True):
            way.becomes(Conditions(**received[name]), now_ns)
        if received["moves"] > self._moves:
            self._moves = received["moves"]
            self._selector.unregister(self._exit)
            self._exit.close()
            self._exit = self._new_exit()
        if received["replays"] > self._replays:
            self._replays = received["replays"]
            for datagram in self._kept:
                _send(self._elsewhere, datagram, self._robot)
        if received["hostile_hz"] != self._hostile_hz:
            self._hostile_hz = received["hostile_hz"]
            self._hostile_since_ns, self._hostile_now = now_ns, 0

    def step(self) -> None:
        """Pass on what came and what is due."""
        there, back = self._ways
        now_ns = time.monotonic_ns()
        waits = [one.next_ns for one in self._ways if one.next_ns is not None]
        wait_s = min([_POLL_S, *((due_ns - now_ns) / NS_PER_S for due_ns in waits)])
        for key, _ in self._selector.select(max(wait_s, 0.0)):
            self._read(key.fileobj)
        now_ns = time.monotonic_ns()
        for datagram in there.due(now_ns):
            _send(self._exit, datagram, self._robot)
        for datagram in back.due(now_ns):
            if self._caller is not None:
                _send(self._entrance, datagram, self._caller)
        self._attack(now_ns)

    def _attack(self, now_ns: int) -> None:
        due = (now_ns - self._hostile_since_ns) * self._hostile_hz // NS_PER_S - self._hostile_now
        if due <= 0 or self._caller is None or not self._kept or not self._kept_back:
            return
        self._hostile_now += due
        for _ in range(due):
            self.hostile += 1
            source = self._exit if self.hostile % 2 else self._elsewhere
            _send(source, hostile(self.hostile, self._kept, self._draw), self._robot)
            datagram = hostile(self.hostile, self._kept_back, self._draw)
            _send(self._entrance, datagram, self._caller)

    def close(self) -> None:
        """Close the sockets."""
        self._selector.close()
        self._entrance.close()
        self._exit.close()
        self._elsewhere.close()

    def _read(self, source: Any) -> None:
        there, back = self._ways
        while True:
            try:
                datagram, address = source.recvfrom(_LARGEST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # nothing listens there (yet)
                continue
            now_ns = time.monotonic_ns()
            if source is self._entrance:
                self._caller = address
                if len(self._kept) < _KEPT:
                    self._kept.append(datagram)
                there.offer(now_ns, datagram)
            else:
                if len(self._kept_back) < _KEPT:
                    self._kept_back.append(datagram)
                back.offer(now_ns, datagram)

    def _new_exit(self) -> socket.socket:
        out = _udp("")
        self._selector.register(out, selectors.EVENT_READ)
        return out


@dataclass
class ImpairedLink:
    """A relay process; `port` is what the operator's side must call."""

    robot: tuple[str, int]
    there: Conditions = field(default_factory=Conditions)
    back: Conditions = field(default_factory=Conditions)
    port: int = 0
    hostile: int = 0  # so many had reached each side when it was told something last
    _moves: int = 0
    _replays: int = 0
    _hostile_hz: int = 0

    def __enter__(self) -> ImpairedLink:
        asked = {"robot": self.robot, **self._state()}
        self._process = HelperProcess("impaired", __name__, asked, None)
        self._process.start()
        self.port = int(self._process.wait_ready()["port"])
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.stop()

    def passage(self, there: Passage, back: Passage) -> int:
        """Open, cut or hold each way; when it was in force [ns]."""
        self.there = replace(self.there, passage=there)
        self.back = replace(self.back, passage=back)
        return self.tell()

    def move(self) -> int:
        """The operator's side has another address from now on; when it was in force [ns]."""
        self._moves += 1
        return self.tell()

    def replay(self) -> int:
        """All that the operator's side has sent is sent again, from elsewhere; when [ns]."""
        self._replays += 1
        return self.tell()

    def attack(self, hostile_hz: int) -> int:
        """So many hostile datagrams a second reach each side; when it was in force [ns]."""
        self._hostile_hz = hostile_hz
        return self.tell()

    def tell(self) -> int:
        """Tell the process how `there` and `back` are now; when it was in force [ns]."""
        self._process.send(**self._state())
        ready = self._process.wait_ready()
        self.hostile = int(ready["hostile"])
        return int(ready["t_ns"])

    def _state(self) -> dict[str, Any]:
        ways = {"there": asdict(self.there), "back": asdict(self.back)}
        counts = {"moves": self._moves, "replays": self._replays}
        return {**ways, **counts, "hostile_hz": self._hostile_hz}


def _udp(host: str) -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    one.setblocking(False)
    one.bind((host, 0))
    return one


def _send(out: socket.socket, datagram: bytes, address: tuple[str, int]) -> None:
    try:
        out.sendto(datagram, address)
    except OSError:
        return  # no buffer, or nothing listens there: what a network does is lose it


def main() -> None:
    """Pass datagrams on until the input closes."""
    side = HelperSide()
    asked = side.specification
    ways = [Way(Conditions(**asked[name]), seed) for seed, name in enumerate(("there", "back"))]
    relay = Relay((str(asked["robot"][0]), int(asked["robot"][1])), *ways)
    use_fifo(RELAY_PRIORITY)
    side.ready(port=relay.port)
    received = side.received
    while not side.stop_requested.is_set():
        if side.received is not received:
            received = side.received
            relay.follow(received)
            side.ready(t_ns=time.monotonic_ns(), hostile=relay.hostile)
        relay.step()
    relay.close()


if __name__ == "__main__":
    main()

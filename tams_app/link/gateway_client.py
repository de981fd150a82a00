"""The application's side of the gateway: start, messages, events, end."""

from __future__ import annotations

import base64
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from tams_app.link.gateway import (
    BYE,
    EVENT,
    LARGEST_BYTES,
    MESSAGE,
    RECEIVED,
    ROUTES,
    LinkEvent,
    Routes,
)
from tams_app.runtime.process import HelperProcess

_CHANNEL_BUFFER_BYTES = 1_000_000
# A robot's side is silent to whom it does not know, so that these cannot be distinguished here:
NO_ANSWER = (
    "no answer: the call does not arrive there, or it is refused (another key or version of TAMS), "
    "and the robot's terminal says why"
)
_AT_ONCE = 256  # messages taken in one call: a second of them, after a stall


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The robot's side's address, and the keys that it shares with the operator's.

    key: the key's file; on the robot's side also a folder of keys that it accepts; None: no secret,
        which loopback alone may have.
    """

    host: str
    port: int
    key: Path | None


@dataclass(frozen=True, slots=True)
class Received:
    """A message of the other side: when it was received [ns], and in which session of the link."""

    heard_ns: int
    session: int
    content: bytes


NO_EVENT = LinkEvent(
    connected=False,
    sessions=0,
    left=False,
    busy=False,
    operator="",
    revoked=False,
    renewals=0,
    address="",
    counts={},
    welcome=None,
)


class Gateway:
    """One gateway process. `launch`, `wait_ready`; `receive` and `send` from one thread; `close`.

    `event`: how the link stood when it was reported last.
    """

    def __init__(
        self,
        side: Literal["robot", "operator"],
        endpoint: Endpoint,
        welcome: bytes,
        log_directory: Path | None,
    ) -> None:
        """`welcome`: what the other side is told when the link begins; an operator's is short."""
        self.event = NO_EVENT
        self.port = 0  # of this computer, once it is ready
        self.entrance_port = 0  # for all streams that are to leave, once it is ready
        # messages whole, and the end of either side is a broken pipe or an empty read for the other
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for one in (ours, theirs):
            one.setblocking(False)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _CHANNEL_BUFFER_BYTES)
        self._channel, self._theirs = ours, theirs
        specification: dict[str, Any] = {
            "side": side,
            "key": None if endpoint.key is None else str(endpoint.key.resolve()),
            "host": endpoint.host,
            "port": endpoint.port,
            "welcome": base64.b64encode(welcome).decode(),
            "channel": theirs.fileno(),
        }
        self.process = HelperProcess(
            "link", "tams_app.link.gateway", specification, log_directory, (theirs.fileno(),)
        )

    def launch(self) -> None:
        """Start the process without waiting."""
        self.process.start()
        self._theirs.close()  # so that its end can be noticed

    def wait_ready(self) -> None:
        """Wait until it listens or calls; HelperError if it cannot."""
        ready = self.process.wait_ready()
        self.port, self.entrance_port = int(ready["port"]), int(ready["entrance"])

    def follow(self, routes: Routes) -> None:
        """Hand the other side's streams over to these ports from now on."""
        self._put(ROUTES + msgspec.msgpack.encode(routes))

    def send(self, message: bytes) -> None:
        """Send a message, if there is a session; never waits."""
        self._put(MESSAGE + message)

    def receive(self) -> list[Received]:
        """Messages since the last call; never waits."""
        messages: list[Received] = []
        for _ in range(_AT_ONCE):
            try:
                content = self._channel.recv(LARGEST_BYTES)
            except (BlockingIOError, ConnectionResetError):
                break
            if not content:
                break
            if content[:1] == EVENT:
                self.event = msgspec.msgpack.decode(content[1:], type=LinkEvent)
            else:
                heard_ns, session = RECEIVED.unpack_from(content, 1)
                messages.append(Received(heard_ns, session, content[1 + RECEIVED.size :]))
        return messages

    def send_goodbye(self) -> None:
        """Notify the other side that this one leaves."""
        self._put(BYE)

    def close(self) -> None:
        """End the process; may be called twice."""
        self.process.stop()
        self._theirs.close()
        self._channel.close()

    def _put(self, content: bytes) -> None:
        try:
            self._channel.send(content)
        except (BlockingIOError, BrokenPipeError, ConnectionResetError):
            return  # full, or gone: its owner notices its end, and the newest message counts

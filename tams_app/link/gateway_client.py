"""The application's side of the gateway, and what the two send each other through a socket pair.

What they send are the structs of `FromGateway` and `FromApplication`, as MessagePack with a tag.
"""

from __future__ import annotations

import base64
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec

from tams_app.runtime.process import HelperProcess

LARGEST_BYTES = 65_536
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


class Received(msgspec.Struct, frozen=True, tag=True):
    """A message of the other side: when it was received [ns], and in which session of the link."""

    heard_ns: int
    session: int
    content: bytes


class LinkEvent(msgspec.Struct, frozen=True, tag=True):
    """The state of the link, sent to the application twice a second and when it changes.

    sessions: with an operator; renewals: how often a session's keys were replaced. operator: whose
    key the connected operator has, or the last one had, "" on loopback without keys. revoked:
    they were let go because their key is accepted no longer. counts: datagrams that changed
    nothing, by reason. welcome: what the robot's side sends. introduction: what the operator's side
    did. refusal: who called the robot's side in vain, and why. certificate: DER, that the robot's
    side shows to who calls now.
    """

    connected: bool = False
    sessions: int = 0
    left: bool = False
    busy: bool = False
    operator: str = ""
    revoked: bool = False
    renewals: int = 0
    address: str = ""
    counts: dict[str, int] = {}
    welcome: bytes | None = None
    introduction: bytes = b""
    refusal: str = ""
    certificate: bytes = b""


class Outgoing(msgspec.Struct, frozen=True, tag=True):
    """A message for the other side."""

    content: bytes


class Routes(msgspec.Struct, frozen=True, tag=True):
    """Loopback ports of the streams that arrive, by SSRC."""

    rtp: dict[int, int]
    rtcp: dict[int, int]


class Goodbye(msgspec.Struct, frozen=True, tag=True):
    """This side leaves, which the other side is to know."""


class PageAccess(msgspec.Struct, frozen=True, tag=True):
    """From now on pages of these origins may call that prove `code`, shape (16,).

    is_alone: and nobody who has a key.
    """

    code: bytes
    origins: tuple[str, ...]
    is_alone: bool


FromGateway: TypeAlias = Received | LinkEvent
FromApplication: TypeAlias = Outgoing | Routes | Goodbye | PageAccess


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
        """`welcome`: sent to the other side when the link begins; an operator's is short."""
        self.event = LinkEvent()
        self._decoder = msgspec.msgpack.Decoder(FromGateway)
        self.host, self.port = "", 0  # of this computer, once it is ready
        self.identity = b""  # of the robot, once it is ready
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
        self.host, self.identity = str(ready["host"]), bytes.fromhex(ready["identity"])

    def follow(self, routes: Routes) -> None:
        """Hand the other side's streams over to these ports from now on."""
        self._put(routes)

    def let_in(self, page: PageAccess) -> None:
        """Answer the page's calls as well."""
        self._put(page)

    def send(self, message: bytes) -> None:
        """Send a message, if there is a session; never waits."""
        self._put(Outgoing(message))

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
            said: FromGateway = self._decoder.decode(content)
            if isinstance(said, LinkEvent):
                self.event = said
            else:
                messages.append(said)
        return messages

    def send_goodbye(self) -> None:
        """Notify the other side that this one leaves."""
        self._put(Goodbye())

    def close(self) -> None:
        """End the process; may be called twice."""
        self.process.stop()
        self._theirs.close()
        self._channel.close()

    def _put(self, said: FromApplication) -> None:
        try:
            self._channel.send(msgspec.msgpack.encode(said))
        except (BlockingIOError, BrokenPipeError, ConnectionResetError):
            return  # full, or gone: its owner notices its end, and the newest message counts

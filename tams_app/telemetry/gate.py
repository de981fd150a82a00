"""The log's channels live over a WebSocket: where, and who is admitted, by Origin and by number.

A browser lets any web page open a WebSocket to this computer, and names the page's origin in the
request (RFC 6455, 10.2). Foxglove's SDK does not look at it. So the server listens where a page
cannot find it, and this gate passes on only requests of origins that are allowed.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
import socket
import threading
from collections.abc import Collection
from dataclasses import dataclass

from foxglove import Context, start_server

from tams_app.errors import ConfigError, SetupError
from tams_app.runtime.worker import Worker

MOST_VIEWERS = 8
_MOST_CALLERS = 32  # viewers, and those whose request is not whole yet
_HEAD_BYTES, _HEAD_S = 8192, 2.0
_CHUNK_BYTES = 1 << 18
_STOP_POLL_S, _GOODBYE_S = 0.1, 0.5


@dataclass(frozen=True, slots=True)
class Address:
    """A host by name or address, and one of its ports."""

    host: str
    port: int

    @staticmethod
    def of(text: str, option: str, example: str) -> Address:
        """HOST:PORT (IPv6: [HOST]:PORT); ConfigError of `option` if it is not that."""
        host, colon, port = text.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        if not colon or not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ConfigError(f"{option}: {text!r} is not HOST:PORT, such as {example}")
        return Address(host, int(port))

    @property
    def url(self) -> str:
        """The URL to connect to."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"ws://{host}:{self.port}"

    @property
    def is_private(self) -> bool:
        """True if only this computer reaches it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def check_address(address: Address) -> None:
    """SetupError in one sentence unless `address` can be used now."""
    bound(address).close()


def bound(address: Address) -> socket.socket:
    """A socket at `address`; SetupError if it cannot be used."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM
        )[0]
        bound = socket.socket(family, kind, protocol)
        try:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(place)
        except OSError:
            bound.close()
            raise
    except (OSError, UnicodeError) as error:
        raise unusable(address, str(getattr(error, "strerror", "") or error)) from error
    return bound


def unusable(address: Address, why: str) -> SetupError:
    """The error of an address that cannot be used."""
    return SetupError(
        f"--foxglove: nothing can connect at {address.host}:{address.port} ({why}): "
        "give another HOST:PORT of this computer"
    )


def hidden_host() -> str:
    """One of the 16 million loopback addresses: no web page tries all of them on all ports."""
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


def refusal(head: bytes, origins: Collection[str], viewers: int) -> tuple[int, str] | None:
    """The refusal of a request: HTTP status and sentence; None if it is passed on.

    `head`: of the request, up to its empty line. A program that is no browser names no origin.
    """
    lines = head.decode("latin-1").split("\r\n")[1:]
    named = [
        value.strip()
        for name, _, value in (line.partition(":") for line in lines)
        if name.strip().lower() == "origin"
    ]
    if len(named) > 1 or any(origin not in origins for origin in named):
        return 403, "this origin may not see the session: recording.foxglove_origins lists who may"
    if viewers >= MOST_VIEWERS:
        return 503, f"{MOST_VIEWERS} viewers are connected already: close one"
    return None


class LiveServer:
    """Serves what a context has, in threads of its own; of a slow viewer messages are dropped."""

    def __init__(
        self, context: Context, address: Address, name: str, origins: Collection[str]
    ) -> None:
        """To programs, and to web pages of `origins`; SetupError if `address` cannot be used."""
        self._listening = bound(address)
        try:
            self._listening.listen()
            host = hidden_host()
            self._server = start_server(
                name=name, host=host, port=0, capabilities=[], context=context
            )
        except (OSError, RuntimeError, ValueError) as error:
            self._listening.close()
            raise unusable(address, str(error)) from error
        self._inner = host, self._server.port
        self._origins = frozenset(origins)
        self._callers: set[asyncio.Task[None]] = set()
        self._viewers = 0
        self._worker = Worker("viewers", self._run)
        self._worker.start()

    def stop(self) -> None:
        """Let the viewers go, with the server's last words."""
        self._server.stop()
        self._worker.stop()
        self._listening.close()

    def _run(self, stop: threading.Event) -> None:
        asyncio.run(self._serve(stop))

    async def _serve(self, stop: threading.Event) -> None:
        server = await asyncio.start_server(
            self._called, sock=self._listening, limit=_HEAD_BYTES, start_serving=True
        )
        while not stop.is_set():
            await asyncio.sleep(_STOP_POLL_S)
        server.close()
        if self._callers:
            _, left = await asyncio.wait(self._callers, timeout=_GOODBYE_S)
            for task in left:
                task.cancel()
            await asyncio.gather(*left, return_exceptions=True)

    def _called(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._callers) >= _MOST_CALLERS:
            writer.close()
            return
        task = asyncio.create_task(self._admit(reader, writer))
        self._callers.add(task)
        task.add_done_callback(self._callers.discard)

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
            if (why := refusal(head, self._origins, self._viewers)) is not None:
                writer.write(_answer(*why))
                await writer.drain()
                return
            self._viewers += 1
            try:
                await self._connect(head, reader, writer)
            finally:
                self._viewers -= 1
        except (OSError, EOFError, asyncio.LimitOverrunError, TimeoutError):
            return  # a viewer that left, or what is none: the session goes on
        finally:
            writer.close()

    async def _connect(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
        try:
            inner_writer.write(head)
            ways = [
                asyncio.ensure_future(_copy(reader, inner_writer)),
                asyncio.ensure_future(_copy(inner_reader, writer)),
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        finally:
            inner_writer.close()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(_CHUNK_BYTES):
        writer.write(data)
        await writer.drain()


def _answer(status: int, sentence: str) -> bytes:
    reason = {403: "Forbidden", 503: "Service Unavailable"}[status]
    return (
        f"HTTP/1.1 {status} {reason}\r\nContent-Type: text/plain\r\nConnection: close\r\n"
        f"Content-Length: {len(sentence)}\r\n\r\n{sentence}"
    ).encode("ascii")

"""The log's channels live, over a WebSocket that Foxglove connects to."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from dataclasses import dataclass

from foxglove import Context, start_server

from tams_app.errors import ConfigError, SetupError
from tams_app.telemetry.gate import Gate, hidden_host


@dataclass(frozen=True, slots=True)
class Address:
    """The address that viewers connect to."""

    host: str
    port: int

    @staticmethod
    def of(text: str) -> Address:
        """HOST:PORT (IPv6: [HOST]:PORT); ConfigError if it is not that."""
        host, colon, port = text.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        if not colon or not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ConfigError(f"--foxglove: {text!r} is not HOST:PORT, such as 127.0.0.1:8765")
        return Address(host, int(port))

    @property
    def url(self) -> str:
        """The WebSocket URL for Foxglove."""
        return (
            f"ws://[{self.host}]:{self.port}"
            if ":" in self.host
            else f"ws://{self.host}:{self.port}"
        )

    @property
    def is_private(self) -> bool:
        """True if only this computer reaches it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def check_address(address: Address) -> None:
    """SetupError in one sentence unless viewers can be served at `address` now."""
    _bound(address).close()


class LiveServer:
    """Serves what a context has, in threads of its own; of a slow viewer messages are dropped."""

    def __init__(
        self, context: Context, address: Address, name: str, origins: Collection[str]
    ) -> None:
        """To programs, and to web pages of `origins`; SetupError if `address` is not to be had."""
        listening = _bound(address)
        try:
            listening.listen()
            inner = hidden_host()
            self._server = start_server(
                name=name, host=inner, port=0, capabilities=[], context=context
            )
        except (OSError, RuntimeError, ValueError) as error:
            listening.close()
            raise _refusal(address, str(error)) from error
        self._gate = Gate(listening, (inner, self._server.port), origins)

    def stop(self) -> None:
        """Let the viewers go."""
        self._server.stop()
        self._gate.close()


def _bound(address: Address) -> socket.socket:
    """A socket at `address`; SetupError if it is not to be had."""
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
        raise _refusal(address, str(getattr(error, "strerror", "") or error)) from error
    return bound


def _refusal(address: Address, why: str) -> SetupError:
    return SetupError(
        f"viewers cannot connect at {address.host}:{address.port} ({why}): "
        "give --foxglove another HOST:PORT of this computer"
    )

"""The log's channels live, over a WebSocket that Foxglove connects to."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass

from foxglove import Context, start_server
from foxglove.websocket import WebSocketServer

from tams_app.errors import ConfigError, SetupError


@dataclass(frozen=True, slots=True)
class Address:
    """Where viewers connect."""

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
        """What Foxglove is told."""
        return (
            f"ws://[{self.host}]:{self.port}"
            if ":" in self.host
            else f"ws://{self.host}:{self.port}"
        )

    @property
    def is_private(self) -> bool:
        """Whether only this computer reaches it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def check_address(address: Address) -> None:
    """SetupError in one sentence unless viewers can be served at `address` now."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except (OSError, UnicodeError) as error:
        raise _refusal(address, str(getattr(error, "strerror", "") or error)) from error


def serve(context: Context, address: Address, name: str) -> WebSocketServer:
    """Serve what `context` has to all who connect; SetupError if the address is not to be had.

    It sends in threads of its own; of a viewer that is too slow messages are dropped.
    """
    try:
        return start_server(
            name=name, host=address.host, port=address.port, capabilities=[], context=context
        )
    except (OSError, RuntimeError, ValueError) as error:
        raise _refusal(address, str(error)) from error


def _refusal(address: Address, why: str) -> SetupError:
    return SetupError(
        f"viewers cannot connect at {address.host}:{address.port} ({why}): "
        "give --foxglove another HOST:PORT of this computer"
    )

"""The address at which a session is served to viewers, or that its two sides talk by."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass

from tams_app.errors import ConfigError, SetupError


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

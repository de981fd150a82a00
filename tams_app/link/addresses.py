"""The addresses of a name: all of them are called, from one socket."""

from __future__ import annotations

import ipaddress
import socket

Address = tuple[str, int] | tuple[str, int, int, int]  # of IPv4, of IPv6
_MAPPED = "::ffff:"  # an IPv4 address on a socket of both families (RFC 4291, 2.5.5.2)


def addresses_of(
    host: str, port: int, loopback_only: bool = False
) -> tuple[int, tuple[Address, ...]]:
    """The family of a socket that reaches them all, and the addresses; OSError, UnicodeError.

    Those of IPv4 are mapped where there are others: one socket calls both. `loopback_only`: an
    OSError unless programs of this computer alone are there, whatever the name stood for before.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    if not _has_ipv6():
        found = [one for one in found if one[0] == socket.AF_INET] or found
    family: int = (
        socket.AF_INET6 if any(one[0] == socket.AF_INET6 for one in found) else socket.AF_INET
    )
    addresses = tuple(dict.fromkeys(_address(one[0], one[4], family) for one in found))
    if loopback_only and not all(map(is_loopback, addresses)):
        raise OSError(f"{host} is not this computer alone, so a key is needed")
    return family, addresses


def datagram_socket(family: int) -> socket.socket:
    """A socket for `addresses_of`; of IPv6 it reaches mapped addresses too."""
    one = socket.socket(family, socket.SOCK_DGRAM)
    if family == socket.AF_INET6:
        one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
    return one


def _has_ipv6() -> bool:
    """True if this computer makes sockets of IPv6; a name may have such addresses all the same."""
    try:
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM).close()
    except OSError:
        return False
    return True


def _address(family: int, at: tuple[object, ...], reached_by: int) -> Address:
    host, port = str(at[0]), int(str(at[1]))
    if family == socket.AF_INET6:
        return host, port, int(str(at[2])), int(str(at[3]))  # whole: with its scope
    return (host, port) if reached_by == family else (_MAPPED + host, port, 0, 0)


def named(address: Address) -> str:
    """HOST:PORT of an address; of IPv6 [HOST]:PORT."""
    host, port = address[0].removeprefix(_MAPPED), address[1]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def called(host: str, port: int) -> str:
    """The name that is called, with its addresses, for the person who calls."""
    try:
        names = [named(address) for address in addresses_of(host, port)[1]]
    except (OSError, UnicodeError):  # who calls says so
        names = []
    itself = named((host, port))
    return itself if names in ([], [itself]) else f"{itself} ({', '.join(names)})"


def is_loopback(address: Address) -> bool:
    """True if only programs of this computer are there."""
    host = address[0].removeprefix(_MAPPED).partition("%")[0]
    return ipaddress.ip_address(host).is_loopback

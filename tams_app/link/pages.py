"""Who may call from a page in a browser: who has the link's code, from the page's own origin.

A browser's first packet carries no greeting. So strangers are answered too, and what they may cost
is limited for each place that they call from, apart from what operators with keys may.
"""

from __future__ import annotations

import hmac
from collections import Counter, OrderedDict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from ipaddress import IPv6Address, ip_address

from tams_app.link.addresses import Address
from tams_app.link.keys import IDENTITY_BYTES, Key
from tams_app.units import NS_PER_S

CODE_BYTES = 16
HANDSHAKES, _ALL_HANDSHAKES = 5, 20  # begun in a second from each place, and from all together
_PLACES_KEPT = 1024


@dataclass(frozen=True, slots=True)
class PageKey(Key):
    """The code of a link, shape (16,), as a key; a browser can compute its identity."""

    def __post_init__(self) -> None:
        identity = hmac.digest(self.secret, b"TAMS page name", sha256)[:IDENTITY_BYTES]
        object.__setattr__(self, "identity", identity)


class Pages:
    """What the door knows of pages, and what they may cost it."""

    def __init__(self, key: PageKey, origins: Iterable[str]) -> None:
        """`origins`: of the pages that may call, as browsers name them (RFC 6454)."""
        self.key = key
        self.origins = frozenset(origin.encode() for origin in origins)
        self._begun_ns: OrderedDict[int, deque[int]] = OrderedDict()  # by place
        self._all_ns: deque[int] = deque(maxlen=_ALL_HANDSHAKES)

    def may_begin(self, address: Address, now_ns: int) -> bool:
        """Whether a handshake with who calls from there may begin now; counts it if so."""
        place = _place_of(address)
        begun_ns = self._begun_ns.setdefault(place, deque(maxlen=HANDSHAKES))
        self._begun_ns.move_to_end(place)
        if len(self._begun_ns) > _PLACES_KEPT:
            self._begun_ns.popitem(last=False)
        for times in (begun_ns, self._all_ns):
            if len(times) == times.maxlen and now_ns - times[0] < NS_PER_S:
                return False
        begun_ns.append(now_ns)
        self._all_ns.append(now_ns)
        return True


def most_crowded(addresses: Sequence[Address]) -> int:
    """The first one of those at the place where most are: who fills a house leaves it first."""
    places = [_place_of(address) for address in addresses]
    return max(range(len(places)), key=lambda number: Counter(places)[places[number]])


def _place_of(address: Address) -> int:
    """An address of IPv4, or the network of IPv6 that one subscriber has."""
    host = ip_address(address[0].partition("%")[0])
    if isinstance(host, IPv6Address):
        return int(host) >> 64 if host.ipv4_mapped is None else int(host.ipv4_mapped)
    return int(host)

"""The helper process that has the link's one UDP port; what it does is up to `door` and `caller`.

Started by `gateway_client.Gateway`. It encrypts what the application's streams and messages send to
the other computer, and hands over what comes from there and is authentic. Messages go through a
socket pair, packets of the streams through loopback ports. Killing this process is a lost link.

Specification: side (robot or operator), key (path, on the robot's side also of a folder, or null),
host and port (to listen on, or to call), welcome (base64: sent to the other side when the link
begins), channel (descriptor).
"""

from __future__ import annotations

import base64
import os
import selectors
import socket
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import msgspec

from tams_app.errors import TamsError
from tams_app.link.addresses import Address, addresses_of, datagram_socket, named
from tams_app.link.caller import Caller
from tams_app.link.certificate import LeafKeeper, leaf
from tams_app.link.channel import Heard, is_rtcp, ssrc_of
from tams_app.link.door import Door
from tams_app.link.gateway_client import (
    LARGEST_BYTES,
    FromApplication,
    FromGateway,
    LinkEvent,
    Outgoing,
    PageAccess,
    Received,
    Routes,
)
from tams_app.link.keys import LOOPBACK_KEY, AcceptedKeys, read_key
from tams_app.link.pages import PageKey, Pages
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import RELAY_PRIORITY, use_fifo
from tams_app.units import NS_PER_MS, NS_PER_S

LOOPBACK = "127.0.0.1"
_BUFFER_BYTES = 4_000_000
_READS_IN_A_ROW = 32  # from one socket: a flood at one port must not hold the others up
_STEP_S = 0.05
_EVENT_NS = 500 * NS_PER_MS
_LOOK_NS = 50 * NS_PER_MS
_KEYS_NS = 500 * NS_PER_MS
# Traffic classes (RFC 8837): an interface whose queue has priorities lets messages pass first.
# Each way of addressing takes its own option, and passes the other one over.
_CLASS_OPTIONS = (socket.IPPROTO_IP, socket.IP_TOS), (socket.IPPROTO_IPV6, socket.IPV6_TCLASS)
_MESSAGE_CLASS = 46 << 2  # EF
_MEDIA_CLASS = 34 << 2  # AF41


class Streams:
    """The application's streams of packets on loopback: their sources and destinations.

    Each stream sends from the port to which what belongs to it is handed over; what comes from any
    other port is another program's. A stream takes packets from this one port alone.
    """

    def __init__(self) -> None:
        self.entrance = _udp(socket.AF_INET, LOOPBACK, 0)  # for all that is to leave
        self._routes = Routes({}, {})
        self._sources: frozenset[Address] = frozenset()

    def follow(self, routes: Routes) -> None:
        """Hand over to these ports from now on, and take in from them alone."""
        self._routes = routes
        ports = {*routes.rtp.values(), *routes.rtcp.values()}
        self._sources = frozenset((LOOPBACK, port) for port in ports)

    def is_ours(self, source: Address) -> bool:
        """True if a stream of the application sends from there."""
        return source in self._sources

    def hand_over(self, packet: bytes) -> bool:
        """Give a packet to the stream that its SSRC names; whether there is one."""
        rtcp = is_rtcp(packet)
        ports = self._routes.rtcp if rtcp else self._routes.rtp
        port = ports.get(ssrc_of(packet))
        if port is None:
            return False
        with suppress(OSError):  # the stream is gone: what a network does is lose it
            self.entrance.sendto(packet, (LOOPBACK, port))
        return True

    def close(self) -> None:
        """Close the socket."""
        self.entrance.close()


class Carrier:
    """The sockets of one end, and the loop that serves them."""

    def __init__(
        self,
        end: Door | Caller,
        outer: socket.socket,
        channel: socket.socket,
        streams: Streams,
        keys: AcceptedKeys | None = None,
        clock: Clock | None = None,
    ) -> None:
        """`keys`: what the robot's side accepts; looked at again twice a second."""
        self._leaves = None if keys is None else LeafKeeper(keys.identity)
        self._end: Final = end
        self._keys = keys
        self._outer, self._channel, self._streams = outer, channel, streams
        self._clock = clock or MonotonicClock()
        self._sessions = 0
        self._left = self._revoked = False
        self._address: Address = ("", 0)
        self._reported: LinkEvent | None = None
        self._reported_ns = self._looked_ns = self._keys_looked_ns = 0
        self._changed = False  # more than counts may have
        self._decoder = msgspec.msgpack.Decoder(FromApplication)
        self._selector = selectors.DefaultSelector()
        self._selector.register(outer, selectors.EVENT_READ, self._from_outside)
        self._selector.register(channel, selectors.EVENT_READ, self._from_application)
        self._selector.register(streams.entrance, selectors.EVENT_READ, self._from_stream)

    @property
    def ready(self) -> dict[str, Any]:
        """What the application is to know: where this is, and whose end it is."""
        host, port, *_ = self._outer.getsockname()
        return {
            "host": host,
            "port": port,
            "entrance": self._streams.entrance.getsockname()[1],
            "identity": "" if self._keys is None else self._keys.identity.public.hex(),
        }

    def run(self, stop: threading.Event) -> None:
        """Carry datagrams until `stop` is set."""
        while not stop.is_set():
            self.turn()
        self._send(self._end.goodbye(self._clock.now_ns()))

    def close(self) -> None:
        """Close everything."""
        self._selector.close()
        self._outer.close()
        self._channel.close()
        self._streams.close()

    def turn(self) -> None:
        """Wait a moment for what there is to read, carry it, and do what is due."""
        now_ns = self._clock.now_ns()
        due_ns = self._end.due_ns(now_ns)
        wait_s = _STEP_S if due_ns is None else min((due_ns - now_ns) / NS_PER_S, _STEP_S)
        for key, _ in self._selector.select(max(wait_s, 0.0)):
            key.data(key.fileobj)
        now_ns = self._clock.now_ns()
        self._send(self._end.step(now_ns))
        if isinstance(self._end, Door) and now_ns - self._keys_looked_ns >= _KEYS_NS:
            self._keys_looked_ns = now_ns
            self._look_at_the_keys(self._end, now_ns)
        if not self._changed and now_ns - self._looked_ns < _LOOK_NS:
            return
        self._report(now_ns)

    def _look_at_the_keys(self, end: Door, now_ns: int) -> None:
        if self._leaves is not None:
            end.leaf = self._leaves.current(time.time())
        if self._keys is not None and self._keys.look():
            heard = end.accept(self._keys.keys, now_ns)
            self._revoked = self._revoked or heard.left
            self._act(heard, now_ns)

    def _report(self, now_ns: int) -> None:
        self._changed, self._looked_ns = False, now_ns
        event = self._event()
        if event == self._reported:
            return
        due = now_ns - self._reported_ns >= _EVENT_NS or _without_counts(event, self._reported)
        if due and self._hand_over(event):
            self._reported, self._reported_ns = event, now_ns

    def _event(self) -> LinkEvent:
        end = self._end
        caller = end if isinstance(end, Caller) else None
        door = end if isinstance(end, Door) else None
        return LinkEvent(
            connected=end.connected,
            sessions=self._sessions,
            left=self._left,
            busy=caller is not None and caller.busy,
            operator="" if door is None else door.operator,
            revoked=self._revoked,
            renewals=end.renewals,
            address=named(self._address) if end.connected or self._address[1] else "",
            counts=dict(end.counts),
            welcome=None if caller is None else caller.welcome,
            introduction=b"" if door is None else door.introduction,
            refusal="" if door is None else door.refusal,
            certificate=b"" if door is None else door.leaf.der,
        )

    def _from_outside(self, outer: socket.socket) -> None:
        for _ in range(_READS_IN_A_ROW):
            try:
                datagram, address = outer.recvfrom(LARGEST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # an ICMP message: nothing listens there (yet)
                continue
            now_ns = self._clock.now_ns()
            heard = self._end.receive(datagram, address, now_ns)
            self._act(heard, now_ns)

    def _act(self, heard: Heard, now_ns: int) -> None:
        self._send(heard.replies)
        if heard.connected or heard.left:
            self._left, self._changed = heard.left, True
        if self._end.connected and self._end.address != self._address:
            self._address, self._changed = self._end.address, True
        if heard.connected:
            self._sessions += 1
            self._revoked = False
            self._report(now_ns)  # before its first message
        for message in heard.messages:
            self._hand_over(Received(now_ns, self._sessions, message))
        for packet in heard.media:
            if not self._streams.hand_over(packet):
                self._end.counts["of no stream"] += 1

    def _from_application(self, channel: socket.socket) -> None:
        for _ in range(_READS_IN_A_ROW):
            try:
                content = channel.recv(LARGEST_BYTES)
            except BlockingIOError:
                return
            except ConnectionResetError:
                content = b""
            if not content:  # the application has gone, and this process ends in a moment
                self._selector.unregister(channel)
                return
            said: FromApplication = self._decoder.decode(content)
            if isinstance(said, Routes):
                self._streams.follow(said)
            elif isinstance(said, Outgoing):
                self._send(self._end.message(said.content, self._clock.now_ns()))
            elif isinstance(said, PageAccess):
                self._let_in(said)
            else:
                self._send(self._end.goodbye(self._clock.now_ns()))

    def _let_in(self, page: PageAccess) -> None:
        assert isinstance(self._end, Door)
        assert self._keys is not None, "pages call a robot"
        key = PageKey("page", page.code, self._keys.identity.public)
        self._end.pages = Pages(key, page.origins)
        if page.is_alone:
            self._end.accept({}, self._clock.now_ns())

    def _from_stream(self, entrance: socket.socket) -> None:
        for _ in range(_READS_IN_A_ROW):
            try:
                packet, source = entrance.recvfrom(LARGEST_BYTES)
            except BlockingIOError:
                return
            if self._streams.is_ours(source):
                self._send(self._end.media(packet, self._clock.now_ns()), _MEDIA_CLASS)
            else:
                self._end.counts["of another program"] += 1

    def _send(
        self, addressed: list[tuple[bytes, Address]], traffic_class: int = _MESSAGE_CLASS
    ) -> None:
        value = traffic_class.to_bytes(4, sys.byteorder)
        ancillary = [(*option, value) for option in _CLASS_OPTIONS]
        for datagram, address in addressed:
            with suppress(OSError):  # no route, no buffer: what a network does is lose it
                self._outer.sendmsg([datagram], ancillary, 0, address)

    def _hand_over(self, said: FromGateway) -> bool:
        """Hand something to the application; whether it can be. Full: it stalls, newer follow."""
        try:
            self._channel.send(msgspec.msgpack.encode(said))
        except (BlockingIOError, ConnectionResetError, BrokenPipeError):
            return False
        return True


def _without_counts(event: LinkEvent, reported: LinkEvent | None) -> bool:
    """True if more has changed than the counts."""
    return reported is None or msgspec.structs.replace(event, counts=reported.counts) != reported


def _udp(family: int, host: str, port: int) -> socket.socket:
    one = datagram_socket(family)
    try:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        one.setblocking(False)
        one.bind((host, port))
    except OSError:
        one.close()
        raise
    return one


def _carrier(specification: Mapping[str, Any], stack: ExitStack) -> Carrier:
    """The carrier that is asked for; OSError, TamsError if impossible."""
    given = specification["key"]
    path = None if given is None else Path(given)
    host, port = specification["host"], int(specification["port"])
    robot = specification["side"] == "robot"
    end: Door | Caller
    family: int
    keys = None
    welcome = base64.b64decode(specification["welcome"])
    if robot:
        keys = AcceptedKeys(path)
        end = Door(keys.keys, leaf(keys.identity, time.time()), welcome, os.urandom)
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        outer = _udp(family, str(address[0]), port)
    else:
        key = LOOPBACK_KEY if path is None else read_key(path)
        family, addresses = addresses_of(host, port, loopback_only=path is None)
        # bound to no address of this computer: it may get another one on the way
        anywhere = "::" if family == socket.AF_INET6 else "0.0.0.0"
        end, outer = Caller(key, addresses, os.urandom, welcome), _udp(family, anywhere, 0)
    stack.callback(outer.close)
    channel = socket.socket(fileno=int(specification["channel"]))
    channel.setblocking(False)
    streams = Streams()
    stack.callback(streams.close)
    return Carrier(end, outer, channel, streams, keys)


def main() -> None:
    """The helper's main function."""
    side = HelperSide()
    with ExitStack() as stack:
        try:
            carrier = _carrier(side.specification, stack)
        except (OSError, UnicodeError, OverflowError) as error:  # no address, name or port
            host, wanted = side.specification["host"], side.specification["port"]
            reason = getattr(error, "strerror", None) or error
            side.fail(f"{host}:{wanted} cannot be used: {reason}")
            return
        except TamsError as error:
            side.fail(str(error))
            return
        stack.callback(carrier.close)
        use_fifo(RELAY_PRIORITY)
        side.ready(**carrier.ready)
        carrier.run(side.stop_requested)


if __name__ == "__main__":
    main()

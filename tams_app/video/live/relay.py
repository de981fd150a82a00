"""The link as a process of its own: every datagram between the video ends passes through here.

Started by `RelayClient`. Real UDP sockets; the arithmetic is `link.Link`. Per view
three flows come in at the entrances and leave for the exits: RTP and sender reports through the
bottleneck, feedback straight back. Datagrams of other programs are left out. Killing this process
is a network that went away.
"""

from __future__ import annotations

import heapq
import select
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from tams_app.config import Network
from tams_app.errors import ConfigError
from tams_app.records import IP_UDP_HEADER_BYTES, PacketFate, PacketKind, PacketRecord
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import RELAY_PRIORITY, use_fifo
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import Link
from tams_app.video.core.packets import identify
from tams_app.video.live.networks import network_capacity
from tams_app.video.live.reporting_helper import line_of, reports_to_session
from tams_app.video.live.udp import ViewPorts

REPORT_PERIOD_NS = 50 * NS_PER_MS
# A session that stalls for a minute at 1000 packets/s leaves no gap in its records.
REPORT_BUFFER_BYTES = 15_000_000

_FLOWS = ("rtp", "reports", "feedback")
_RECEIVE_BUFFER_BYTES = 4_000_000
_LARGEST_DATAGRAM_BYTES = 65_536
_READS_IN_A_ROW = 32  # then see what is due: a flood must not hold deliveries up


@dataclass(frozen=True, slots=True)
class Route:
    """One flow of one view: where it comes in, and where it goes out.

    source: the one address from which it is taken in. way_out: the socket by which it leaves, the
    one to which its receiver sends.
    """

    view: str
    flow: str  # its field in `ViewPorts`
    source: tuple[str, int]
    way_out: socket.socket
    exit: tuple[str, int]


class ReportStream:
    """Records on their way to the session; never waits.

    `connection` becomes non-blocking. Bytes the session has not read stay here, up to
    `REPORT_BUFFER_BYTES`; beyond that whole reports are left out.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._unsent = bytearray()
        self._gone = False

    def put(self, records: list[PacketRecord]) -> None:
        """Queue one report and send what the connection takes."""
        line = line_of(records)
        if not self._gone and len(self._unsent) + len(line) <= REPORT_BUFFER_BYTES:
            self._unsent += line
        self.flush()

    def flush(self) -> None:
        """Send what the connection takes now."""
        while self._unsent and not self._gone:
            try:
                sent = self._connection.send(self._unsent)
            except BlockingIOError:
                return
            except (BrokenPipeError, ConnectionResetError):
                self._gone = True  # the session closes the relay itself; video goes on till then
                return
            del self._unsent[:sent]

    def close(self, timeout_s: float = 0.5) -> None:
        """Send the rest, for at most `timeout_s`, and disconnect."""
        deadline_ns = time.monotonic_ns() + round(timeout_s * NS_PER_S)
        self.flush()
        while self._unsent and not self._gone and time.monotonic_ns() < deadline_ns:
            select.select([], [self._connection], [], timeout_s)
            self.flush()
        self._connection.close()


class Relay:
    """The sockets, the packets on their way, and the loop that moves them."""

    def __init__(self, link: Link, exits: Mapping[str, ViewPorts], reports: ReportStream) -> None:
        """Bind the entrances on each exit's host, at any free ports; OSError if impossible."""
        self._link = link
        self._reports = reports
        self._entrances: dict[tuple[str, str], socket.socket] = {}  # by view and flow
        self._routes: dict[socket.socket, Route] = {}  # by entrance
        self._on_the_way: list[tuple[int, int, Route, bytes]] = []  # (due, order, ...)
        self._order = 0
        self._records: list[PacketRecord] = []
        try:
            for view, ports in exits.items():
                self._open(view, ports)
        except OSError:
            self.close()
            raise

    def _open(self, view: str, ports: ViewPorts) -> None:
        host = ports.host
        for flow in _FLOWS:
            self._entrances[view, flow] = _entrance(host)
        sender, receiver = (host, ports.feedback), (host, ports.rtp)
        for flow in _FLOWS:
            back = flow == "feedback"
            self._routes[self._entrances[view, flow]] = Route(
                view,
                flow,
                source=receiver if back else sender,
                way_out=self._entrances[view, "rtp" if back else "feedback"],
                exit=(host, getattr(ports, flow)),
            )

    def entrances(self) -> dict[str, ViewPorts]:
        """The ports that senders and receivers must send to."""
        ports: dict[str, dict[str, Any]] = {}
        for (view, flow), entrance in self._entrances.items():
            host, port = entrance.getsockname()
            ports.setdefault(view, {"host": host})[flow] = port
        return {view: ViewPorts(**flows) for view, flows in ports.items()}

    def run(self, stop: threading.Event) -> None:
        sockets = list(self._routes)
        next_report_ns = time.monotonic_ns() + REPORT_PERIOD_NS
        while not stop.is_set():
            self._deliver_due()
            wake_ns = next_report_ns
            if self._on_the_way:
                wake_ns = min(wake_ns, self._on_the_way[0][0])
            wait_s = max(0, wake_ns - time.monotonic_ns()) / NS_PER_S
            for entrance in select.select(sockets, [], [], wait_s)[0]:
                self._take_in(entrance, self._routes[entrance])
            if time.monotonic_ns() >= next_report_ns:
                self._report()
                next_report_ns = time.monotonic_ns() + REPORT_PERIOD_NS
        self._report()

    def close(self) -> None:
        """Close the entrances and the report stream."""
        for entrance in self._entrances.values():
            entrance.close()
        self._reports.close()

    def _take_in(self, entrance: socket.socket, route: Route) -> None:
        for _ in range(_READS_IN_A_ROW):
            try:
                datagram, source = entrance.recvfrom(_LARGEST_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            if source[:2] != route.source:  # of another program
                continue
            due_ns = self._due_ns(route, datagram, time.monotonic_ns())
            if due_ns is not None:
                self._order += 1
                heapq.heappush(self._on_the_way, (due_ns, self._order, route, datagram))

    def _due_ns(self, route: Route, datagram: bytes, now_ns: int) -> int | None:
        """The time when the datagram comes out; None if it is lost. Uplink packets are recorded."""
        if route.flow == "feedback":
            return self._link.feedback(now_ns, route.view)
        if route.flow == "rtp":
            kind, sequence, timestamp = identify(datagram)
        else:
            kind, sequence, timestamp = PacketKind.RTCP, 0, 0
        size_bytes = len(datagram) + IP_UDP_HEADER_BYTES
        record = self._link.offer(now_ns, route.view, kind, size_bytes, sequence, timestamp)
        self._records.append(record)
        return record.delivered_ns if record.fate is PacketFate.DELIVERED else None

    def _deliver_due(self) -> None:
        while self._on_the_way and self._on_the_way[0][0] <= time.monotonic_ns():
            _, _, route, datagram = heapq.heappop(self._on_the_way)
            with suppress(
                OSError
            ):  # no buffer, or the exit is gone: what a network does is lose it
                route.way_out.sendto(datagram, route.exit)

    def _report(self) -> None:
        if self._records:
            self._reports.put(self._records)
            self._records = []
        else:
            self._reports.flush()  # the end of a long report may still wait


def _entrance(host: str) -> socket.socket:
    entrance = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        entrance.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        entrance.setblocking(False)
        entrance.bind((host, 0))
    except OSError:
        entrance.close()
        raise
    return entrance


def build(specification: dict[str, Any], connection: socket.socket) -> Relay:
    """The relay that a specification asks for; OSError if an address cannot be used."""
    network = Network.model_validate(specification["network"])
    exits = {view: ViewPorts(**ports) for view, ports in specification["exits"].items()}
    capacity = network_capacity(network, specification["epoch_ns"])
    link = Link(network, capacity, exits, specification["seed"])
    return Relay(link, exits, ReportStream(connection))


def main() -> None:
    """The helper's main function; its specification is made by `RelayClient`."""
    side = HelperSide()
    connection = reports_to_session(side.specification, 0.0)
    try:
        relay = build(side.specification, connection)
    except (OSError, ConfigError) as error:
        connection.close()
        side.fail(f"the link relay cannot start ({error}); check the trace")
        return
    use_fifo(RELAY_PRIORITY)
    entrances = {view: asdict(ports) for view, ports in relay.entrances().items()}
    side.ready(entrances=entrances)
    try:
        relay.run(side.stop_requested)
    finally:
        relay.close()


if __name__ == "__main__":
    main()

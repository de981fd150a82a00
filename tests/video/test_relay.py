"""The link relay as a process: real datagrams through real sockets, and its records."""

import os
import signal
import socket
import struct
import time
from contextlib import ExitStack

import pytest

from tams_app.config import Network
from tams_app.errors import HelperError
from tams_app.records import PacketFate, PacketKind
from tams_app.units import NS_PER_MS
from tams_app.video.core.link import Link
from tams_app.video.live.networks import RelayClient, network_capacity
from tams_app.video.live.udp import ViewPorts
from tests.faults.applications import until

pytestmark = pytest.mark.waiting

VIEWS = ("eih", "gt")
FLOWS = ("rtp", "reports", "feedback")
TIMEOUT_S = 20.0


def rtp(sequence, size=200, payload_type=96):
    header = struct.pack("!BBHII", 0x80, payload_type, sequence, 3000 * sequence, 1)
    return header + bytes(size - len(header))


class Ends:
    """The video ends of two views, and a relay between them."""

    def __init__(self, stack, network, tmp_path, **options):
        self.sockets = {}
        for view in VIEWS:
            for flow in FLOWS:
                end = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
                end.bind(("127.0.0.1", 0))
                end.settimeout(TIMEOUT_S)
                self.sockets[view, flow] = end
        exits = {
            view: ViewPorts(
                "127.0.0.1",
                *(self.sockets[view, flow].getsockname()[1] for flow in FLOWS),
            )
            for view in VIEWS
        }
        self.records, self.failures = [], []
        self.client = RelayClient(
            tmp_path, self.records.extend, lambda *failure: self.failures.append(failure)
        )
        stack.callback(self.client.close)
        options = {"epoch_ns": time.monotonic_ns()} | options
        self.entrances = self.client.emulate(network, exits, 5, **options)

    def send(self, view, flow, datagram):
        ports = self.entrances[view]
        source = self.sockets[view, "rtp" if flow == "feedback" else "feedback"]
        source.sendto(datagram, (ports.host, getattr(ports, flow)))

    def receive(self, view, flow):
        return self.sockets[view, flow].recv(65_536)


@pytest.fixture
def between(tmp_path):
    with ExitStack() as stack:
        yield lambda network, **options: Ends(stack, network, tmp_path, **options)


def test_each_flow_of_each_view_comes_out_where_it_belongs_and_is_recorded_as_what_it_was(between):
    """And nothing of another program does."""
    ends = between(Network())
    resent = bytearray(rtp(9, payload_type=97))
    resent[12:14] = (4321).to_bytes(2, "big")
    ends.send("gt", "rtp", bytes(resent))
    assert ends.receive("gt", "rtp") == resent
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for number, view in enumerate(VIEWS, 7):
            for flow in FLOWS:
                ports = ends.entrances[view]
                stranger.sendto(rtp(30_000), (ports.host, getattr(ports, flow)))
                ends.send(view, flow, rtp(number))
                assert ends.receive(view, flow) == rtp(number)
    ends.client.close()
    ends.client.close()
    assert ends.failures == []
    found = {(one.view, one.kind.name): one for one in ends.records}
    assert len(found) == len(ends.records) == 5
    assert found.keys() == {("gt", "REPAIR")} | {
        (view, kind) for view in VIEWS for kind in ("MEDIA", "RTCP")
    }
    media, repair = found["gt", "MEDIA"], found["gt", "REPAIR"]
    assert (media.sequence, media.size_bytes, media.rtp_timestamp) == (8, 228, 24_000)
    assert (repair.sequence, found["eih", "MEDIA"].sequence) == (4321, 7)


def test_the_packets_that_arrive_are_those_the_link_lets_through(between):
    network = Network(latency_ms=5, jitter_ms=2, loss=0.2)
    ends = between(network)
    for sequence in range(300):
        ends.send("eih", "rtp", rtp(sequence))
    model = Link(network, network_capacity(network, 0), VIEWS, 5)
    passed = [
        n
        for n in range(300)
        if model.offer(1, "eih", PacketKind.MEDIA, 228, n).fate is PacketFate.DELIVERED
    ]
    arrived = [int.from_bytes(ends.receive("eih", "rtp")[2:4], "big") for _ in passed]
    assert arrived == passed
    ends.client.close()
    assert len(ends.records) == 300
    assert 0 < 300 - len(passed) == sum(r.fate is PacketFate.LOST for r in ends.records)


def test_no_packet_arrives_before_its_time(between):
    ends = between(Network(latency_ms=40, rate_kbps=3000))
    sent_ns = time.monotonic_ns()
    for sequence in range(20):
        ends.send("eih", "rtp", rtp(sequence, 1200))
    arrivals_ns = []
    for _ in range(20):
        ends.receive("eih", "rtp")
        arrivals_ns.append(time.monotonic_ns())
    ends.client.close()
    assert arrivals_ns[0] - sent_ns >= 43 * NS_PER_MS  # 40 ms and the time of 1228 bytes
    for record, arrival_ns in zip(ends.records, arrivals_ns, strict=True):
        assert arrival_ns >= record.delivered_ns
    assert arrivals_ns[-1] - sent_ns >= (40 + 20 * 3.27) * NS_PER_MS


def test_a_flood_overflows_the_links_queue_and_nothing_else(between):
    ends = between(Network(rate_kbps=20_000, queue_min_bytes=30_000, queue_ms=1))
    for sequence in range(2000):
        ends.send("eih", "rtp", rtp(sequence, 1000))
        if sequence % 100 == 0:
            time.sleep(0.001)  # lets a relay without real-time priority have a turn
    until(lambda: len(ends.records) == 2000, "all records")
    fates = [record.fate for record in ends.records]
    assert fates.count(PacketFate.OVERFLOW) > 0
    assert fates.count(PacketFate.LOST) == 0
    for _ in range(fates.count(PacketFate.DELIVERED)):
        ends.receive("eih", "rtp")
    ends.client.close()


def test_a_trace_begins_at_the_epoch_given(between, tmp_path):
    (tmp_path / "late.csv").write_text("t_ms,kbps\n0,0\n600000,1000\n")
    network = Network(trace=str(tmp_path / "late.csv"))
    epoch_ns = time.monotonic_ns() - 600_000 * NS_PER_MS
    ends = between(network, epoch_ns=epoch_ns)
    ends.send("eih", "rtp", rtp(1))
    assert ends.receive("eih", "rtp") == rtp(1)


def test_a_relay_that_is_killed_is_reported_in_one_sentence(between):
    ends = between(Network())
    os.kill(ends.client.process.pid, signal.SIGKILL)
    until(lambda: ends.failures, "the relay's end")
    ((name, failure),) = ends.failures
    assert name == "relay-reports"
    assert isinstance(failure, HelperError)
    assert "ended unasked" in str(failure)


def test_a_relay_that_cannot_bind_says_so(between, tmp_path):
    client = RelayClient(tmp_path, lambda records: None, lambda name, failure: None)
    nowhere = {"eih": ViewPorts("192.0.2.1", 1, 2, 3)}
    with pytest.raises(HelperError, match=r"the link relay cannot start .*check the trace"):
        client.emulate(Network(), nowhere, seed=1, epoch_ns=0)
    client.close()

"""The connection that QUIC makes, and what of aioquic is used that it does not promise."""

from __future__ import annotations

import os
import random
from itertools import count, pairwise

import pytest
from aioquic.buffer import Buffer
from aioquic.quic.packet import QuicPacketType, pull_quic_header
from aioquic.tls import Epoch
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.quic import (
    ALPN,
    ID_BYTES,
    LONGEST_CONTENT_BYTES,
    LONGEST_DATAGRAM_BYTES,
    OVERHEAD_BYTES,
    SESSION_BYTES,
    Connection,
    Initial,
    Retries,
    destination_of,
    is_initial,
    read_initial,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import DESK, THIEF, shown

pytestmark = pytest.mark.untimed

NOW_NS = 1_000 * NS_PER_S
INITIAL = Initial(b"d" * 8, b"s" * 8, b"token")


class Two:
    """Both sides of a connection, without a network between them."""

    def __init__(self) -> None:
        self.now_ns = NOW_NS
        self.caller = Connection.calling(b"greeting", self.now_ns)
        ((first, *_),) = [self.caller.datagrams(self.now_ns)]
        initial = read_initial(first)
        assert initial is not None
        here = b"h" * ID_BYTES
        retry = Retries(b"s").retry(initial, DESK, here, b"said", self.now_ns)
        self.caller.receive(retry, self.now_ns)
        self.robot = Connection.called(shown(), initial.destination, here)
        self.streams = {True: b"", False: b""}
        self.contents: dict[bool, list[bytes]] = {True: [], False: []}
        self.complete = 0
        self.carry()

    def carry(self) -> int:
        """All that both have to send arrives; how many datagrams."""
        carried = 0
        for at_robot in (True, False) * 4:
            sender, receiver = self.caller, self.robot
            if not at_robot:
                sender, receiver = receiver, sender
            for datagram in sender.datagrams(self.now_ns):
                came = receiver.receive(datagram, self.now_ns)
                carried += 1
                self.streams[at_robot] += came.stream
                self.contents[at_robot] += came.contents
                self.complete += came.complete
                if came.begun and at_robot:
                    self.robot.write(b"asked")
        return carried


def test_what_is_used_of_aioquic_without_its_promise_is_there_and_of_its_kind() -> None:
    two = Two()
    quic = two.robot._quic
    assert quic._loss._pacer.packet_time is None
    assert quic._loss._pto_count == 0
    assert quic._loss.bytes_in_flight == 0
    assert quic._close_event is None
    assert (two.caller._quic._retry_count, quic._peer_token) == (1, b"")
    assert two.caller._quic._peer_token.startswith(b"\x02")
    assert quic._cryptos[Epoch.ONE_RTT] is two.robot._keys
    assert (
        0 in quic._spaces[Epoch.ONE_RTT].received_packets
        or quic._spaces[Epoch.ONE_RTT].received_packets
    )
    assert two.caller.certificate == shown().certificate
    assert quic.tls.alpn_negotiated == ALPN


def test_both_sides_know_when_the_handshake_is_complete_and_the_first_word_came_with_it() -> None:
    two = Two()
    assert two.complete == 2
    assert two.streams == {True: b"", False: b"asked"}
    two.caller.write(b"answered")
    two.carry()
    assert two.streams[True] == b"answered"


@pytest.mark.parametrize("length", [0, 1, 63, 64, LONGEST_CONTENT_BYTES])
def test_a_datagram_is_as_long_as_is_said(length: int) -> None:
    two = Two()
    two.now_ns += NS_PER_S
    two.carry()
    assert two.robot.put(bytes(length))
    (datagram,) = two.robot.datagrams(two.now_ns)
    assert len(datagram) == length + OVERHEAD_BYTES - (length < 64)
    assert OVERHEAD_BYTES + LONGEST_CONTENT_BYTES == LONGEST_DATAGRAM_BYTES - SESSION_BYTES
    assert two.caller.receive(datagram, two.now_ns).contents == [bytes(length)]


def test_a_datagram_that_is_too_long_is_refused_and_blocks_nothing() -> None:
    two = Two()
    assert not two.robot.put(bytes(LONGEST_CONTENT_BYTES + 1))
    two.robot.put(b"next")
    two.carry()
    assert two.contents[False] == [b"next"]


def test_ten_thousand_datagrams_that_nobody_acknowledges_leave_at_once() -> None:
    two = Two()
    sent = 0
    for _ in range(10_000):
        two.now_ns += 10_000
        two.robot.put(bytes(1000))
        sent += sum(len(one) > 1000 for one in two.robot.datagrams(two.now_ns))
    assert sent == 10_000


def test_the_other_sides_close_ends_a_connection() -> None:
    two = Two()
    two.caller._quic.close()
    two.carry()
    assert two.robot.ended
    assert two.robot.datagrams(two.now_ns) == []
    assert two.robot.due_ns() is None


def test_a_connection_that_is_not_sound_ends_and_nothing_is_answered() -> None:
    two = Two()
    two.caller._quic._streams_blocked_pending = True
    two.caller._quic.send_stream_data(0, bytes(20_000))  # more than is allowed
    two.caller._quic._remote_max_data = two.caller._quic._remote_max_stream_data_bidi_remote = (
        1 << 20
    )
    two.caller._quic._streams[0].max_stream_data_remote = 1 << 20
    for datagram in two.caller.datagrams(two.now_ns) + two.caller.datagrams(two.now_ns):
        two.robot.receive(datagram, two.now_ns)
    assert two.robot.ended
    assert two.robot.datagrams(two.now_ns) == []


def test_an_error_that_aioquic_lets_out_ends_the_connection_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    two = Two()

    def raises(*_: object) -> None:
        raise KeyError("of a parser")

    monkeypatch.setattr(two.robot._quic, "receive_datagram", raises)
    assert two.robot.receive(b"anything", two.now_ns).contents == []
    assert (two.robot.ended, two.robot.counts) == (True, {"not sound": 1})


def test_what_is_to_be_written_on_a_stream_that_the_other_side_broke_ends_the_connection() -> None:
    two = Two()
    two.caller._quic.stop_stream(1, 0)
    two.carry()
    two.robot.write(b"welcome")
    assert two.robot.ended


def test_streams_beside_the_one_are_passed_over() -> None:
    two = Two()
    two.caller._quic.send_stream_data(0, b"another")
    two.carry()
    assert two.streams[True] == b""
    assert not two.robot.ended


def test_a_caller_asks_again_at_an_even_pace() -> None:
    caller = Connection.calling(b"greeting", NOW_NS)
    caller.datagrams(NOW_NS)
    due_ns = []
    for _ in range(10):
        at_ns = caller.due_ns()
        assert at_ns is not None
        due_ns.append(at_ns)
        assert caller.datagrams(at_ns)
    assert {round((after - before) / NS_PER_MS) for before, after in pairwise(due_ns)} == {200}


# --- before there is a connection -----------------------------------------------------------------


@given(st.binary(max_size=80))
def test_the_header_of_a_first_packet_is_read_as_aioquic_reads_it(token: bytes) -> None:
    ((first,),) = [Connection.calling(token, NOW_NS).datagrams(NOW_NS)]
    header = pull_quic_header(Buffer(data=first))
    assert read_initial(first) == Initial(header.destination_cid, header.source_cid, token)
    assert destination_of(first) == header.destination_cid
    assert is_initial(first)


def test_nonsense_of_any_length_is_no_first_packet_or_has_a_token_that_is_none() -> None:
    draw = random.Random(1)
    for number in range(5000):
        noise = draw.randbytes(draw.randrange(1, 1500))
        destination_of(noise)
        read_initial(noise)
        begun = bytes((0xC0 | number % 16,)) + b"\0\0\0\1" + noise
        initial = read_initial(begun)
        assert initial is None or ID_BYTES <= len(initial.destination) <= 20


def test_a_first_packet_that_is_short_or_of_another_kind_or_version_is_none() -> None:
    ((first,),) = [Connection.calling(b"token", NOW_NS).datagrams(NOW_NS)]
    assert read_initial(first[:-1]) is None
    for kind in (0x40, 0xD0, 0xE0, 0xF0):
        assert read_initial(bytes((kind,)) + first[1:]) is None
    for version in (0, 2, 0x6B33_43CF):
        assert read_initial(first[:1] + version.to_bytes(4) + first[5:]) is None


@given(st.binary(min_size=ID_BYTES, max_size=20), st.binary(max_size=60))
def test_what_a_retry_packet_says_comes_back(original: bytes, said: bytes) -> None:
    retries, initial = Retries(b"secret"), Initial(original, b"s" * 8, b"")
    packet = retries.retry(initial, DESK, b"h" * ID_BYTES, said, NOW_NS)
    header = pull_quic_header(Buffer(data=packet))
    assert header.packet_type == QuicPacketType.RETRY
    assert (header.source_cid, header.destination_cid) == (b"h" * 8, b"s" * 8)
    here, token = header.source_cid, header.token
    assert token is not None
    assert retries.read(token, here, DESK, NOW_NS) == (original, said)
    assert Retries(b"another").read(token, here, DESK, NOW_NS) is None
    assert retries.read(token, here, THIEF, NOW_NS) is None
    assert retries.read(token, b"x" * 8, DESK, NOW_NS) is None


@pytest.mark.parametrize("given_ns", [NOW_NS, NOW_NS + 1, NOW_NS + 5 * NS_PER_S - 1])
def test_a_proof_of_an_address_is_valid_for_five_to_ten_seconds(given_ns: int) -> None:
    retries = Retries(b"secret")
    packet = retries.retry(INITIAL, DESK, b"h" * ID_BYTES, b"", given_ns)
    token = pull_quic_header(Buffer(data=packet)).token
    assert token is not None
    for later_ns in count(given_ns, NS_PER_S // 2):
        if retries.read(token, b"h" * ID_BYTES, DESK, later_ns) is None:
            break
    assert 5 * NS_PER_S <= later_ns - given_ns <= 10 * NS_PER_S


def test_a_changed_proof_is_none() -> None:
    retries = Retries(os.urandom(32))
    packet = retries.retry(INITIAL, DESK, b"h" * ID_BYTES, b"said", NOW_NS)
    token = pull_quic_header(Buffer(data=packet)).token
    assert token is not None
    for at in range(len(token)):
        changed = bytearray(token)
        changed[at] ^= 1
        assert retries.read(bytes(changed), b"h" * ID_BYTES, DESK, NOW_NS) is None
    for length in range(len(token)):
        assert retries.read(token[:length], b"h" * ID_BYTES, DESK, NOW_NS) is None

"""Who gets in at the robot's end from a page, beside operators with keys."""

from __future__ import annotations

import random
import struct
from dataclasses import replace
from ssl import CERT_NONE

import pytest
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DatagramReceived, HeadersReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.events import HandshakeCompleted, ProtocolNegotiated, StreamDataReceived
from cryptography.hazmat.primitives.serialization import Encoding

from tams_app.link.addresses import Address
from tams_app.link.channel import GOODBYE, LINK, MESSAGE, Heard
from tams_app.link.door import PROVE_NS, UNPROVEN, Door
from tams_app.link.keys import Key
from tams_app.link.pages import HANDSHAKES, PageKey, Pages
from tams_app.link.proof import Busy, Challenge, Meeting, Proof, Welcome, WordStream, filled, framed
from tams_app.link.quic import LONGEST_CONTENT_BYTES, LONGEST_DATAGRAM_BYTES, STREAM_BYTES, _Unpaced
from tams_app.link.webtransport import PATH
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    DESK,
    IDENTITY,
    KEY,
    LET_GO_MS,
    OTHER_KEY,
    ROBOT,
    THIEF,
    Desk,
    Rig,
    datagram_of,
    flipped,
    is_retry,
    robot,
    rtp,
)

pytestmark = pytest.mark.untimed

ORIGIN = "http://127.0.0.1:8080"
CODE = PageKey("page", b"c" * 16, IDENTITY.public)
SCREEN: Address = ("10.0.0.4", 40_002)
PROVE_MS = PROVE_NS / NS_PER_MS


class Browser:
    """A browser's end, as `Desk` has one; `status` of the session that it asks for."""

    def __init__(self, key: Key, path: str, origin: str, protocols: list[str]) -> None:
        self.status, self.busy, self.welcome = b"", False, b""
        self.session, self._stream = 0, -1
        self._key, self._path, self._origin = key, path, origin
        configuration = QuicConfiguration(
            is_client=True,
            alpn_protocols=protocols,
            congestion_control_algorithm="tams",
            verify_mode=CERT_NONE,
            max_datagram_frame_size=65_536,
            max_datagram_size=LONGEST_DATAGRAM_BYTES,
        )
        self.quic = QuicConnection(configuration=configuration)
        self.quic._loss._pacer = _Unpaced(max_datagram_size=LONGEST_DATAGRAM_BYTES)
        self.http: H3Connection | None = None
        self._words = WordStream()
        self._number = 0
        self._has_called = False

    def step(self, now_ns: int) -> list[tuple[bytes, Address]]:
        now_s = now_ns / NS_PER_S
        if not self._has_called:
            self._has_called = True
            self.quic.connect(ROBOT, now_s)
        elif (timer := self.quic.get_timer()) is not None and timer <= now_s:
            self.quic.handle_timer(now_s)
        return [(one, ROBOT) for one, _ in self.quic.datagrams_to_send(now_s)]

    def receive(self, datagram: bytes, _: Address, now_ns: int) -> Heard:
        self.quic.receive_datagram(datagram, ROBOT, now_ns / NS_PER_S)
        heard = Heard()
        while (event := self.quic.next_event()) is not None:
            if isinstance(event, ProtocolNegotiated):
                self.http = H3Connection(self.quic, enable_webtransport=True)
            elif isinstance(event, HandshakeCompleted):
                self._ask()
            elif isinstance(event, StreamDataReceived) and event.stream_id == self._stream:
                self._read(event.data)  # aioquic's client would look for the stream's head here too
                continue
            for one in [] if self.http is None else self.http.handle_event(event):
                if isinstance(one, HeadersReceived):
                    self.status = dict(one.headers)[b":status"]
                    if self.status == b"200":
                        assert self.http is not None
                        self._stream = self.http.create_webtransport_stream(self.session)
                elif isinstance(one, DatagramReceived) and one.data[0] == MESSAGE:
                    length = int.from_bytes(one.data[5:7])
                    heard.messages.append(one.data[7 : 7 + length])
                elif isinstance(one, DatagramReceived):
                    heard.media.append(one.data)
        heard.replies = self.step(now_ns)
        return heard

    def message(self, content: bytes, now_ns: int) -> list[tuple[bytes, Address]]:
        if not self.welcome:
            return []
        self._number += 1
        head = struct.pack("!BIH", MESSAGE, self._number, len(content))
        return self.datagram((head + content).ljust(263, b"\0"), now_ns)

    def datagram(self, content: bytes, now_ns: int) -> list[tuple[bytes, Address]]:
        """The session's datagram with this."""
        assert self.http is not None
        self.http.send_datagram(self.session, content)
        return self.step(now_ns)

    def leave(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """Close the session, as browsers do."""
        self.quic.send_stream_data(self.session, b"", end_stream=True)
        return self.step(now_ns)

    def _ask(self) -> None:
        assert self.http is not None
        self.session = self.quic.get_next_available_stream_id()
        asked = {
            ":method": "CONNECT",
            ":protocol": "webtransport",
            ":scheme": "https",
            ":authority": "robot",
            ":path": self._path,
            "origin": self._origin,
        }
        self.http.send_headers(
            self.session, [(name.encode(), value.encode()) for name, value in asked.items()]
        )

    def _read(self, content: bytes) -> None:
        for word in self._words.of(content):
            if isinstance(word, Challenge):
                certificate = self.quic.tls._peer_certificate
                assert certificate is not None
                der = certificate.public_bytes(Encoding.DER)
                self._meeting = Meeting(self._key, der, word.nonce, b"n" * 32)
                told = filled(b"", 256)
                proof = Proof(self._key.identity, b"n" * 32, self._meeting.proof(told), told)
                self.quic.send_stream_data(self._stream, framed(proof))
            elif isinstance(word, Welcome):
                assert word.mac == self._meeting.welcome(word.content)
                self.welcome = word.content
            self.busy = self.busy or isinstance(word, Busy)


class Screen(Desk):
    """A browser in the place of an operator's end."""

    def __init__(
        self,
        key: Key = CODE,
        address: Address = SCREEN,
        path: str = PATH,
        origin: str = ORIGIN,
        protocols: tuple[str, ...] = tuple(H3_ALPN),
    ) -> None:
        super().__init__(address=address)
        self.page = Browser(key, path, origin, list(protocols))
        self.end = self.page  # type: ignore[assignment]


def open_door() -> Door:
    door = robot()
    door.pages = Pages(CODE, [ORIGIN])
    return door


def seated(screen: Screen | None = None) -> tuple[Rig, Screen]:
    """A rig with an operator at a page."""
    rig, screen = Rig(open_door()), screen or Screen()
    rig.run_ms(60, screen)
    assert rig.gets_through(screen)
    return rig, screen


# --- who gets in ----------------------------------------------------------------------------------


def test_a_page_with_the_code_drives_and_sees_as_an_operator_with_a_key_does() -> None:
    rig, screen = seated()
    assert rig.robot.operator == "page"
    assert rig.sessions == 1
    assert screen.page.welcome[2:9] == b"welcome"
    rig.send_down(rig.robot.media(rtp(), rig.now_ns))
    assert screen.media == [rtp()]
    rig.send_up(screen, screen.page.datagram(rtp(2), rig.now_ns))
    assert rig.media == [rtp(2)]


def test_a_browsers_first_packet_is_answered_by_little_and_without_pages_by_nothing() -> None:
    rig, screen = Rig(open_door()), Screen()
    ((first, _),) = screen.page.step(rig.now_ns)
    ((answer, to),) = rig.at_robot(first, SCREEN).replies
    assert (is_retry(answer), to) == (True, SCREEN)
    assert len(answer) < len(first) / 3
    assert rig.robot._knocks == []
    assert Rig().at_robot(first, SCREEN).replies == []


@pytest.mark.parametrize(
    ("screen", "status"),
    [
        (Screen(path="/"), b"404"),
        (Screen(path=PATH + "/"), b"404"),
        (Screen(origin="http://127.0.0.1:8081"), b"403"),
        (Screen(origin="https://127.0.0.1:8080"), b"403"),
        (Screen(origin="null"), b"403"),
    ],
)
def test_another_path_or_a_foreign_page_gets_no_session(screen: Screen, status: bytes) -> None:
    rig = Rig(open_door())
    rig.run_ms(100, screen)
    assert screen.page.status == status
    assert not rig.robot.connected
    rig.run_ms(PROVE_MS, screen)
    assert rig.robot._routes == {}


def test_another_code_is_no_way_in_and_the_terminal_says_so() -> None:
    other = PageKey("page", b"d" * 16, IDENTITY.public)
    named_alike = replace(other)
    object.__setattr__(named_alike, "identity", CODE.identity)
    for key in (other, named_alike):
        rig, screen = Rig(open_door()), Screen(key)
        rig.run_ms(100, screen)
        assert screen.page.status == b"200"
        assert not rig.robot.connected
        assert rig.robot._routes == {}
        assert "the page that calls has another session's link" in rig.robot.refusal


def test_an_operators_key_opens_no_page_and_a_code_is_no_operators_key() -> None:
    rig, screen, desk = Rig(open_door()), Screen(KEY), Desk(CODE)
    rig.run_ms(300, screen, desk)
    assert screen.page.status == b"200"
    assert rig.sessions == 0


def test_a_first_flight_of_two_packets_begins_in_either_order() -> None:
    long = (*H3_ALPN, *(f"{number:0200}" for number in range(5)))  # as keys of post-quantum are
    rig, screen = Rig(open_door()), Screen(protocols=long)
    first = [datagram for datagram, _ in screen.page.step(rig.now_ns)]
    assert len(first) == 2
    ((retry, _),) = rig.at_robot(first[0], SCREEN).replies
    again = screen.page.receive(retry, ROBOT, rig.now_ns).replies
    assert len(again) == 2
    rig.send_up(screen, again[::-1])
    rig.run_ms(100, screen)
    assert rig.gets_through(screen)


def test_a_damaged_copy_of_the_first_packet_neither_counts_nor_takes_its_place() -> None:
    rig, screen = Rig(open_door()), Screen()
    ((first, _),) = screen.page.step(rig.now_ns)
    ((retry, _),) = rig.at_robot(first, SCREEN).replies
    ((again, to),) = screen.page.receive(retry, ROBOT, rig.now_ns).replies
    for copy in random.Random(4).sample(flipped(again)[-1600:], 40):
        rig.at_robot(copy, SCREEN)
    assert rig.robot._knocks == []
    rig.now_ns += NS_PER_S
    rig.send_up(screen, [(again, to)])
    rig.run_ms(100, screen)
    assert rig.gets_through(screen)


# --- one operator ---


@pytest.mark.parametrize("is_page", [False, True])
def test_all_others_are_told_that_it_is_busy(is_page: bool) -> None:
    rig, first = Rig(open_door()), Screen() if is_page else Desk()
    rig.run_ms(60, first)
    screen, desk = Screen(address=("10.0.0.5", 1)), Desk(OTHER_KEY, ("10.0.0.3", 1))
    rig.robot.accept({key.identity: key for key in (KEY, OTHER_KEY)}, rig.now_ns)
    rig.run_ms(200, first, screen, desk)
    assert screen.page.busy
    assert desk.end.busy
    assert rig.sessions == 1
    assert rig.gets_through(first)


@pytest.mark.parametrize("says_goodbye", [False, True])
def test_a_page_that_is_closed_frees_its_place_but_only_who_says_so_has_left(
    says_goodbye: bool,
) -> None:
    rig, screen = seated()
    if says_goodbye:
        goodbye = struct.pack("!BIH", LINK, 10_000, len(GOODBYE)) + GOODBYE
        rig.send_up(screen, screen.page.datagram(goodbye, rig.now_ns))
    rig.send_up(screen, screen.page.leave(rig.now_ns))
    assert rig.departures == says_goodbye
    assert not rig.robot.connected
    desk = Desk()
    rig.run_ms(60, desk)
    assert rig.gets_through(desk)


def test_a_page_that_fell_silent_gives_its_place_to_the_next_and_is_sent_nothing() -> None:
    rig, _ = seated()
    rig.run_ms(LET_GO_MS)
    rig.answers.clear()
    rig.run_ms(200)
    assert rig.answers == []
    again = Screen(address=("10.0.0.5", 1))
    rig.run_ms(60, again)
    assert rig.gets_through(again)
    assert rig.sessions == 2


# --- what strangers may cost ---


def test_strangers_keep_neither_an_operator_nor_a_page_out() -> None:
    rig = Rig(open_door())
    crowd = [Screen(Key("", b"?" * 32), (THIEF[0], port)) for port in range(40)]
    for stranger in crowd:
        stranger.page._ask = lambda: None  # type: ignore[method-assign] # shakes hands, and waits
    rig.run_ms(30, *crowd)
    assert len(rig.robot._knocks) == HANDSHAKES
    for _ in range(4):
        rig.run_ms(300, *crowd[:4])
        assert len(rig.robot._knocks) <= UNPROVEN
    desk = Desk(address=("10.0.0.3", 40_001))
    rig.run_ms(60, desk, *crowd)
    assert rig.gets_through(desk)
    rig.send_up(desk, desk.end.goodbye(rig.now_ns))
    screen = Screen()
    rig.run_ms(60, screen, *crowd)
    assert rig.gets_through(screen)


def test_who_fills_the_places_of_pages_makes_room_before_others_do() -> None:
    rig, waiting, desk = Rig(open_door()), Screen(), Desk()
    ((retry, _),) = rig.at_robot(datagram_of(desk.end.step(rig.now_ns)), DESK).replies
    rig.at_robot(datagram_of(desk.end.receive(retry, ROBOT, rig.now_ns).replies), DESK)
    waiting.page._ask = lambda: None  # type: ignore[method-assign]
    rig.run_ms(30, waiting)
    for port in range(2 * UNPROVEN):
        stranger = Screen(address=(THIEF[0], port))
        stranger.page._ask = lambda: None  # type: ignore[method-assign]
        rig.robot.pages = Pages(CODE, [ORIGIN])  # whatever their rate is
        rig.run_ms(20, stranger)
    addresses = [knock.channel.address for knock in rig.robot._knocks]
    assert len(addresses) == 1 + UNPROVEN
    assert {SCREEN, DESK} < {*addresses}


@pytest.mark.parametrize(
    ("one", "other", "is_one_place"),
    [
        ("10.0.0.4", "10.0.0.4", True),
        ("10.0.0.4", "10.0.0.5", False),
        ("::ffff:10.0.0.4", "10.0.0.4", True),
        ("2001:db8::1", "2001:db8::2", True),
        ("2001:db8::1", "2001:db8:0:1::1", False),
        ("fe80::1%eth0", "fe80::2%eth0", True),
    ],
)
def test_handshakes_are_counted_by_place(one: str, other: str, is_one_place: bool) -> None:
    pages = Pages(CODE, [ORIGIN])
    assert all(pages.may_begin((one, port), 0) for port in range(HANDSHAKES))
    assert not pages.may_begin((one, 99), NS_PER_S - 1)
    assert pages.may_begin((other, 99), NS_PER_S - 1) is not is_one_place
    assert pages.may_begin((one, 99), NS_PER_S)
    later_ns = 9 * NS_PER_S  # of all places together
    assert sum(pages.may_begin((f"10.0.1.{place}", 1), later_ns) for place in range(99)) == 20


# --- in a session ---


def test_the_longest_packet_of_media_fits() -> None:
    rig, screen = seated()
    sent = rig.robot.media(longest := rtp(1, size=LONGEST_CONTENT_BYTES), rig.now_ns)
    assert [len(datagram) for datagram, _ in sent] == [LONGEST_DATAGRAM_BYTES]
    rig.send_down(sent)
    assert screen.media == [longest]


def test_keys_are_renewed_by_the_robots_end_for_a_browser_never_does() -> None:
    rig, screen = seated()
    for renewals in (1, 2):
        for _ in range(300):
            rig.now_ns += NS_PER_S  # a message a second, which is enough to be heard
            rig.step(screen)
        rig.run_ms(100, screen)
        assert rig.robot.renewals == renewals
        assert rig.gets_through(screen)


def test_who_sends_more_on_streams_than_a_page_does_is_let_go() -> None:
    rig, screen = seated()
    stream = screen.page.quic.get_next_available_stream_id()
    content = b"\x21\x80\x10\0\0"  # a frame of a kind that nobody knows, which goes on and on
    for _ in range(STREAM_BYTES // 1000 - 2):
        screen.page.quic.send_stream_data(stream, content.ljust(1000))
        content = b""
        rig.step(screen)
        assert rig.robot.connected
    screen.page.quic.send_stream_data(stream, bytes(3000))
    rig.step(screen)
    assert not rig.robot.connected


@pytest.mark.parametrize("seed", range(6))
def test_nothing_that_a_page_sends_ends_the_robots_end(seed: int) -> None:
    rig, screen = seated()
    draw, page = random.Random(seed), screen.page
    for _ in range(60):
        if not rig.robot.connected:
            rig, screen = seated()
            page = screen.page
        content = draw.choice((b"\x01\x05", b"\x40\x41\0", b"\0", b"")) + draw.randbytes(40)
        match draw.randrange(4):
            case 0:
                rig.send_up(screen, page.datagram(content[: draw.randrange(40)], rig.now_ns))
            case 1:
                page.quic.send_datagram_frame(content)
            case 2:
                stream = page.quic.get_next_available_stream_id(draw.random() < 0.3)
                page.quic.send_stream_data(stream, content, draw.random() < 0.3)
            case _:
                page.quic.send_stream_data(draw.choice((2, 6, 10, 4)), content)
        rig.step(screen)
    rig.run_ms(LET_GO_MS)
    desk = Desk(address=DESK)
    rig.run_ms(60, desk)
    assert rig.gets_through(desk)

"""Floods, recordings and nonsense at both ends: only counters change, and operators get in."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from types import ModuleType

import pytest
from aioquic.quic.crypto import CryptoPair

from tams_app.link import caller, door
from tams_app.link.addresses import Address
from tams_app.link.channel import Heard
from tams_app.link.door import UNPROVEN
from tams_app.link.keys import Key
from tams_app.link.proof import GREETING_NONCE_BYTES, Proof, Welcome, Word, answer, framed, greeting
from tams_app.link.quic import LONGEST_DATAGRAM_BYTES, Connection, read_initial
from tams_app.units import NS_PER_MS
from tests.link.rig import (
    DESK,
    IDENTITY,
    KEY,
    KINDS,
    OTHER_KEY,
    ROBOT,
    THIEF,
    Desk,
    Rig,
    channel_of,
    connected,
    datagram_of,
    hostile,
    is_retry,
    robot,
    rtcp,
    rtp,
    spoilt,
)

pytestmark = pytest.mark.untimed

Attack = Iterator[tuple[bytes, Address]]
GETS_IN_MS = 2000
STRANGER = Key("stranger", b"s" * 32, IDENTITY.public)  # a key that the robot's side does not know
ADDRESSES = (THIEF, DESK, ROBOT)


def state_of(rig: Rig, desk: Desk) -> tuple[object, ...]:
    """All that a stranger must not change."""
    channels = channel_of(rig.robot), channel_of(desk.end)
    said = [(id(one), one.address, one.heard_ns, one._newest) for one in channels]
    renewals, busy = (rig.robot.renewals, desk.end.renewals), desk.end.busy
    heard = [len(one) for one in (rig.heard, rig.media, desk.heard, desk.media)]
    return said, renewals, busy, heard, rig.sessions, rig.departures, len(rig.robot._routes)


def exchanged(rig: Rig, desk: Desk) -> list[bytes]:
    """Real datagrams of every kind and both directions that were received."""
    rig.run_ms(50, desk)
    for number in range(20):
        rig.say(desk, b"m" * number)
        rig.tell(b"m" * number)
        rig.send_up(desk, desk.end.media(rtcp(), rig.now_ns))
        rig.send_down(rig.robot.media(rtp(number), rig.now_ns))
    return [*desk.sent, *desk.came]


def is_ignored(rig: Rig, datagram: bytes, address: Address) -> bool:
    """Whether the robot's side answers no more than a short Retry packet to a recorded call."""
    replies = rig.at_robot(datagram, address).replies
    return all(
        to == address and is_retry(one) and len(one) < len(datagram) / 5 for one, to in replies
    )


def test_two_hundred_thousand_hostile_datagrams_leave_a_session_as_it_is() -> None:
    """Noise, recordings in any order, and copies that were changed, from anywhere."""
    rig, desk = connected()
    real = exchanged(rig, desk)
    draw = random.Random(4)
    before = state_of(rig, desk)
    for number in range(100_000):
        datagram = hostile(number, real, draw)
        assert is_ignored(rig, datagram, draw.choice(ADDRESSES))
        assert desk.end.receive(datagram, ROBOT, rig.now_ns).replies == []
        if number % 5000 == 4999:
            assert state_of(rig, desk) == before
            assert rig.gets_through(desk)
            rig.step(desk)
            before = state_of(rig, desk)
    for end in (rig.robot, desk.end):
        assert min(end.counts[one] for one in ("not authentic", "late")) > 5000
        assert sum(end.counts.values()) > 90_000


@pytest.mark.parametrize("length", [1, 9, 21, 40, LONGEST_DATAGRAM_BYTES, 65_507])
def test_junk_of_every_first_byte_is_not_answered_and_changes_nothing(length: int) -> None:
    """Also such as goes on as real packets do: with connection ids and with QUIC's version."""
    rig, desk = connected()
    draw = random.Random(length)
    heads = [b"", desk.sent[0], desk.came[1], desk.sent[-1], desk.came[-1]]
    before = state_of(rig, desk)
    for first in range(256):
        for head in heads:
            start = bytes((first,)) + head[1 : draw.randrange(1, 30)]
            junk = (start + draw.randbytes(length))[:length]
            for address in ADDRESSES:
                assert rig.at_robot(junk, address).replies == []
            assert desk.end.receive(junk, ROBOT, rig.now_ns).replies == []
    assert state_of(rig, desk) == before
    assert rig.gets_through(desk)


class Raced(Rig):
    """Each packet of an operator comes from elsewhere first."""

    def at_robot(self, datagram: bytes, address: Address) -> Heard:
        self.send_down(super().at_robot(datagram, THIEF).replies)
        return super().at_robot(datagram, address)


def test_packets_that_come_from_elsewhere_first_move_no_session_and_keep_nobody_out() -> None:
    """What goes there are Retry packets, then a question now and then."""
    rig, desk = Raced(), Desk()
    rig.run_ms(GETS_IN_MS, desk)
    assert desk.end.connected
    seen, asked = len(desk.heard), len(rig.answers)
    rig.run_ms(10_000, desk)
    there = [datagram for datagram, to in rig.answers[asked:] if to == THIEF]
    assert 10 <= len(there) <= 110
    assert (rig.robot.address, rig.sessions, len(desk.heard) - seen) == (DESK, 1, 1000)


@pytest.mark.parametrize("is_operator", [True, False])
def test_who_says_nonsense_under_their_own_keys_ends_only_their_session(is_operator: bool) -> None:
    """Now and then a packet that no sound end seals, of any kind of frame (RFC 9000, 19)."""
    draw = random.Random(5)
    for _ in range(12):
        rig, desk = connected()
        keys = channel_of(desk.end if is_operator else rig.robot).connection._keys
        assert keys is not None

        def sealed(head: bytes, said: bytes, number: int, keys: CryptoPair = keys) -> bytes:
            if draw.random() < 0.2:
                kind = draw.choice((said[0], draw.randrange(0x32)))
                said = bytes((kind,)) + (spoilt(said, draw) + said)[1 : len(said)]
            return CryptoPair.encrypt_packet(keys, head, said, number)

        keys.encrypt_packet = sealed
        rig.run_ms(1000, desk)
        assert gets_in_later(rig)


def gets_in_later(rig: Rig) -> bool:
    """Whether another operator gets in once the first is silent."""
    rig.run_ms(3500)
    rig.run_ms(GETS_IN_MS, other := Desk(address=(DESK[0], 3)))
    return rig.gets_through(other)


@pytest.mark.parametrize(("module", "word"), [(caller, Proof), (door, Welcome)])
def test_who_goes_on_with_nonsense_in_the_moment_of_getting_in_is_not_in(
    module: ModuleType, word: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    def and_nonsense(said: Word) -> bytes:
        return framed(said) + (b"\0\1\xc1" if isinstance(said, word) else b"")

    rig, desk = Rig(), Desk()
    with monkeypatch.context() as patch:
        patch.setattr(module, "framed", and_nonsense)
        rig.run_ms(GETS_IN_MS, desk)
        assert not desk.end.connected
    assert gets_in_later(rig)


@pytest.mark.parametrize("is_up", [True, False])
@pytest.mark.parametrize("which", range(4))
def test_a_bit_that_flips_in_a_packet_of_the_handshake_keeps_no_operator_out(
    is_up: bool, which: int
) -> None:
    """The changed copy comes before the packet, or in its place."""
    draw = random.Random(which)
    for run in range(10):
        rig, desk, numbers = Rig(), Desk(), count()

        def spoil(datagram: bytes) -> bool:
            if next(numbers) != which:  # noqa: B023 - called in this turn of the loop
                return True
            at = 8 * len(datagram) - 1 - int(draw.random() ** 3 * 8 * len(datagram))
            copy = (int.from_bytes(datagram) ^ 1 << at).to_bytes(len(datagram))  # often in its head
            if is_up:
                rig.send_down(rig.at_robot(copy, DESK).replies)  # noqa: B023
            else:
                rig.at_desk(desk, copy)  # noqa: B023
            return run % 2 == 0  # noqa: B023

        setattr(rig, "up" if is_up else "down", spoil)
        rig.run_ms(GETS_IN_MS, desk)
        assert next(numbers) > which
        assert rig.gets_through(desk), (run, rig.robot.counts, desk.end.counts)


class Siege(Rig):
    """Before each datagram of an operator pass 20 ms, in which hostile ones arrive."""

    def __init__(self, attack: Callable[[Siege, random.Random], Attack], rate_hz: int) -> None:
        super().__init__(robot(KEY, OTHER_KEY))
        self.to_strangers = 0  # datagrams
        # strangers who go on when they are answered
        self._thieves: dict[Address, tuple[Key, Connection]] = {}
        self._back: list[tuple[bytes, Address]] = []
        self._attack, self._per_ms = attack(self, random.Random(rate_hz)), rate_hz // 1000

    def pass_ms(self, duration_ms: int) -> None:
        """Let time pass."""
        for _ in range(duration_ms):
            self.now_ns += NS_PER_MS
            for _ in range(self._per_ms):
                self.send_down(self.at_robot(*next(self._attack)).replies)
            self.send_down(self.robot.step(self.now_ns))
            assert len(self.robot._knocks) <= UNPROVEN

    def send_up(self, desk: Desk, datagrams: Sequence[tuple[bytes, Address]]) -> None:
        for one in datagrams:
            self.pass_ms(20)
            super().send_up(desk, [one])

    def send_down(self, datagrams: Sequence[tuple[bytes, Address]]) -> None:
        super().send_down(datagrams)
        for datagram, to in datagrams:
            self.to_strangers += to[0] != DESK[0]
            if to in self._thieves:
                key, thief = self._thieves[to]
                came = thief.receive(datagram, self.now_ns)
                if came.asked:
                    thief.answer(answer(key, came.asked))
                if came.complete and to[1] % 2:
                    thief.write(b"\0\7nothing")
                self._back += [(one, to) for one in thief.datagrams(self.now_ns)]

    def strange(self, draw: random.Random) -> Attack:
        """First packets of QUIC without a greeting, or with one of no key; and junk."""
        tokens = [b"", draw.randbytes(41), b"\x02" + draw.randbytes(60)]
        tokens += [greeting(STRANGER, draw.randbytes(GREETING_NONCE_BYTES)) for _ in range(5)]
        real = [Connection.calling(token, 0).datagrams(0)[0] for token in tokens]
        for address in _addresses():
            call = draw.choice(real)
            yield call[:6] + draw.randbytes(8) + call[14:], address  # for a connection of its own
            noise = draw.randbytes(draw.choice((0, 20, LONGEST_DATAGRAM_BYTES - 1)))
            yield bytes((draw.choice(KINDS),)) + noise, address

    def shaking(self, draw: random.Random) -> Attack:
        """Who has recorded calls that were never answered, and goes on with what answers them."""
        calls = [read_initial(datagram_of(Desk().end.step(0))) for _ in range(50)]
        greetings = [one.token for one in calls if one is not None]
        for address in _addresses():
            yield from self._thief(STRANGER, draw.choice(greetings), address)

    def inside(self, draw: random.Random) -> Attack:
        """Who has another key, calls on and on, and says nonsense or nothing as a proof."""
        for address in _addresses():
            token = greeting(OTHER_KEY, draw.randbytes(GREETING_NONCE_BYTES))
            yield from self._thief(OTHER_KEY, token, address)

    def _thief(self, key: Key, token: bytes, address: Address) -> Attack:
        one = Connection.calling(token, self.now_ns)
        self._thieves[address] = key, one
        yield one.datagrams(self.now_ns)[0], address
        back, self._back = self._back, []
        yield from back


def _addresses() -> Iterator[Address]:
    return ((f"198.51.100.{number % 256}", 1 + number % 60_000) for number in count())


@pytest.mark.parametrize("attack", [Siege.strange, Siege.shaking, Siege.inside])
@pytest.mark.parametrize("rate_hz", [1000, pytest.param(10_000, marks=pytest.mark.verify)])
def test_an_operator_gets_in_within_two_seconds_whatever_arrives_beside_them(
    attack: Callable[[Siege, random.Random], Attack], rate_hz: int
) -> None:
    """After strangers were alone for a while, and while they go on; again and again."""
    siege = Siege(attack, rate_hz)
    siege.pass_ms(1500)
    assert siege.to_strangers == 0 or attack != Siege.strange
    assert siege.robot._knocks == [] or attack == Siege.inside
    for times in range(1, 4):
        desk, began_ns = Desk(address=(DESK[0], times)), siege.now_ns
        while not desk.end.connected:
            siege.send_up(desk, desk.end.step(siege.now_ns))
            siege.pass_ms(1)
            assert siege.now_ns - began_ns < GETS_IN_MS * NS_PER_MS, siege.robot.counts
        assert siege.sessions == times
        siege.robot._drop(channel_of(siege.robot))  # as if they had left
    assert (siege.heard, siege.media) == ([], [])

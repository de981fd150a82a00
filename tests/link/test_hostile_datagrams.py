"""Floods, recordings and nonsense at both ends: only counters change, and operators get in."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from heapq import heappop, heappush
from itertools import count

import pytest

from tams_app.link.addresses import Address
from tams_app.link.door import UNPROVEN
from tams_app.link.quic import LONGEST_DATAGRAM_BYTES, VERSION
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    DESK,
    KINDS,
    ROBOT,
    THIEF,
    Desk,
    Rig,
    channel_of,
    connected,
    datagram_of,
    everything,
    hostile,
    is_long,
    rtcp,
    rtp,
)

pytestmark = pytest.mark.untimed

GETS_IN_MS = 1000
Attack = Iterator[tuple[bytes, Address]]


# --- what was received ----------------------------------------------------------------------------


def state_of(rig: Rig, desk: Desk) -> tuple[object, ...]:
    """All that a stranger must not change."""
    robot, operator = channel_of(rig.robot), channel_of(desk.end)
    return (
        id(robot),
        robot.address,
        robot.heard_ns,
        robot._newest,
        rig.robot.renewals,
        id(operator),
        operator.address,
        operator.heard_ns,
        operator._newest,
        desk.end.renewals,
        desk.end.busy,
        desk.end.welcome,
        desk.end._attempts,
        rig.sessions,
        rig.departures,
        len(rig.robot._knocks),
        len(rig.robot._routes),
        len(rig.heard),
        len(desk.heard),
        len(rig.media),
        len(desk.media),
    )


def exchanged(rig: Rig, desk: Desk) -> list[bytes]:
    """Real datagrams of every kind and both directions that were received."""
    rig.run_ms(50, desk)  # so that nothing else is due
    real = [*desk.sent, *desk.came]
    for number in range(20):
        for end in (desk.end, rig.robot):
            real.append(datagram_of(end.message(b"m" * number, rig.now_ns)))
            real += [datagram_of(end.media(one, rig.now_ns)) for one in (rtp(number), rtcp())]
    for datagram in real:
        rig.at_robot(datagram, desk.address)
        rig.at_desk(desk, datagram)
    return real


def test_twenty_thousand_hostile_datagrams_leave_a_session_as_it_is() -> None:
    rig, desk = connected()
    real = exchanged(rig, desk)
    draw = random.Random(4)
    before = state_of(rig, desk)
    for number in range(20_000):
        datagram = hostile(number, real, draw)
        address = draw.choice((THIEF, desk.address, ROBOT))
        rig.at_robot(datagram, address)
        rig.at_desk(desk, datagram)
        if number % 1000 == 999:
            assert state_of(rig, desk) == before
            assert rig.gets_through(desk)
            assert rig.sessions == 1
            rig.now_ns += NS_PER_MS
            before = state_of(rig, desk)
    assert sum(rig.robot.counts.values()) > 15_000
    assert sum(desk.end.counts.values()) > 15_000
    for end, other in ((desk.end, rig.robot), (rig.robot, desk.end)):
        addressed = datagram_of(end.media(rtp(100), rig.now_ns))
        assert other.receive(addressed, desk.address, rig.now_ns).media == [rtp(100)]


def test_of_calls_that_came_to_nothing_few_are_kept_and_not_for_long() -> None:
    rig = Rig()
    for number in range(100):
        rig.now_ns += NS_PER_S // 10
        rig.robot.step(rig.now_ns)
        desk = Desk(address=(DESK[0], 1 + number % 3))
        for call, _ in desk.end.step(rig.now_ns):
            for retry, _ in rig.at_robot(call, desk.address).replies:
                for second, _ in desk.end.receive(retry, ROBOT, rig.now_ns).replies:
                    rig.at_robot(second, desk.address)
        assert len(rig.robot._knocks) <= UNPROVEN
        assert len(rig.robot._routes) <= 2 * UNPROVEN
    rig.now_ns += 2 * NS_PER_S
    rig.robot.step(rig.now_ns)
    assert (rig.robot._knocks, rig.robot._routes) == ([], {})


# --- who gets in ----------------------------------------------------------------------------------


def one_byte(_: random.Random) -> Attack:
    """Datagrams of one byte, the first of a call."""
    while True:
        yield b"\xc0", THIEF


def junk(draw: random.Random) -> Attack:
    """Nonsense that begins as a call does and is as long, and other nonsense."""
    for number in count():
        noise = draw.randbytes(LONGEST_DATAGRAM_BYTES)
        if number % 2:
            yield b"\xc3" + VERSION + b"\x08" + noise[:8] + b"\x08" + noise[8:-10], THIEF
        else:
            yield bytes((draw.choice(KINDS),)) + noise[: draw.randrange(200)], THIEF


def recorded_calls(draw: random.Random) -> list[bytes]:
    """Of operators whom another robot's side answered: what their handshakes were made of."""
    real: list[bytes] = []
    for _ in range(5):
        rig, desk = Rig(), Desk()
        rig.step(desk)
        real += [one for one in desk.sent if is_long(one)]
    draw.shuffle(real)
    return real


def recorded(draw: random.Random) -> Attack:
    """Calls that were recorded, again and again from one address."""
    real = recorded_calls(draw)
    while True:
        yield draw.choice(real), THIEF


def spoofed(draw: random.Random) -> Attack:
    """Calls that were recorded, from any address, also the operator's own."""
    real = recorded_calls(draw)
    for number in count():
        address = DESK if number % 3 == 0 else (f"198.51.100.{number % 256}", number % 60_000)
        yield draw.choice(real), address


def mixed(draw: random.Random) -> Attack:
    """All of them, and what both sides of a session have sent."""
    real = exchanged(*connected())
    attacks = [one_byte(draw), junk(draw), recorded(draw), spoofed(draw)]
    for number in count():
        yield next(attacks[number % 5]) if number % 5 < 4 else (hostile(number, real, draw), THIEF)


ATTACKS: dict[str, Callable[[random.Random], Attack]] = {
    "one byte": one_byte,
    "junk": junk,
    "recorded": recorded,
    "spoofed": spoofed,
    "mixed": mixed,
}


class Siege:
    """Virtual time in steps of 1 ms, a network of 20 ms each way, and hostile datagrams."""

    def __init__(self, attack: Attack, rate_hz: int) -> None:
        self.rig = Rig()
        self.hostile = 0
        self.hostile_bytes = self.answered_bytes = 0
        self._attack, self._rate_hz = attack, rate_hz
        self._owed = 0.0
        self._coming: list[tuple[int, int, bool, bytes, Desk]] = []
        self._numbers = count()

    def run_ms(self, duration_ms: int, desk: Desk | None, until_in: bool = False) -> int | None:
        """Let time pass; after how long the operator was in, if that is waited for."""
        for ms in range(duration_ms):
            self._step(desk)
            if until_in and desk is not None and desk.end.connected and self.rig.robot.connected:
                return ms + 1
        return None

    def _step(self, desk: Desk | None) -> None:
        rig = self.rig
        rig.now_ns += NS_PER_MS
        self._owed += self._rate_hz / 1000
        while self._owed >= 1:
            self._owed -= 1
            datagram, address = next(self._attack)
            self.hostile += 1
            self.hostile_bytes += len(datagram)
            for reply, to in rig.at_robot(datagram, address).replies:
                self.answered_bytes += len(reply)
                if desk is not None and to == desk.address:
                    self._send(False, reply, desk)
        if desk is not None:
            self._let_talk(desk)
        while self._coming and self._coming[0][0] <= rig.now_ns:
            _, _, up, datagram, one = heappop(self._coming)
            if up:
                for reply, to in rig.at_robot(datagram, one.address).replies:
                    assert to == one.address
                    self._send(False, reply, one)
            else:
                for reply, _ in one.end.receive(datagram, ROBOT, rig.now_ns).replies:
                    self._send(True, reply, one)

    def _let_talk(self, desk: Desk) -> None:
        now_ns = self.rig.now_ns
        ups, downs = desk.end.step(now_ns), self.rig.robot.step(now_ns)
        if now_ns // NS_PER_MS % 8 == 0:
            ups += desk.end.message(b"hand", now_ns)
        if now_ns // NS_PER_MS % 16 == 0:
            downs += self.rig.robot.message(b"s", now_ns)
        for datagram, _ in ups:
            self._send(True, datagram, desk)
        for datagram, to in downs:
            if to == desk.address:
                self._send(False, datagram, desk)

    def _send(self, up: bool, datagram: bytes, desk: Desk) -> None:
        at_ns = self.rig.now_ns + 20 * NS_PER_MS
        heappush(self._coming, (at_ns, next(self._numbers), up, datagram, desk))


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize(
    ("rate_hz", "datagrams"),
    [(120, 600), (10_000, 20_000), pytest.param(50_000, 1_000_000, marks=pytest.mark.verify)],
)
def test_an_operator_gets_in_within_a_second_whatever_arrives_beside_them(
    attack: str, rate_hz: int, datagrams: int
) -> None:
    """While no operator is connected, and while one calls; again and again."""
    siege = Siege(ATTACKS[attack](random.Random(rate_hz)), rate_hz)
    siege.run_ms(1000 * datagrams // rate_hz // 2, None)
    assert (siege.rig.robot.connected, siege.rig.heard, siege.rig.media) == (False, [], [])
    tried = 0
    while tried < 3 or siege.hostile < datagrams:
        desk = Desk()
        in_ms = siege.run_ms(GETS_IN_MS, desk, until_in=True)
        assert in_ms is not None, f"not in after {tried} others"
        tried += 1
        assert siege.rig.sessions == tried
        siege.run_ms(200, desk)
        assert siege.rig.heard
        siege.rig.robot._drop(channel_of(siege.rig.robot))  # as if it had left
        siege.run_ms(200, None)
    assert siege.answered_bytes <= siege.hostile_bytes
    assert len(siege.rig.robot._greetings) <= tried


def test_an_operator_who_is_there_stays_whatever_arrives_beside_them() -> None:
    siege = Siege(mixed(random.Random(0)), 10_000)
    desk = Desk()
    assert siege.run_ms(GETS_IN_MS, desk, until_in=True)
    heard = len(siege.rig.heard)
    siege.run_ms(2000, desk)
    assert len(siege.rig.heard) - heard >= 246
    assert siege.rig.sessions == 1
    assert desk.calls == 0  # it has sent through the siege alone
    assert desk.end._attempts == []


def test_the_operators_own_calls_sent_again_from_their_own_address_keep_nobody_out() -> None:
    """Each begins one handshake, once."""
    rig, desk = Rig(), Desk()
    rig.down = lambda datagram: len(datagram) < 200  # no answer but to first calls arrives
    rig.run_ms(9_000, desk)
    calls = [datagram for datagram in desk.sent if is_long(datagram)]
    begun = len(rig.robot._greetings)
    assert 0 < begun <= 2
    for number in range(20_000):
        rig.now_ns += NS_PER_MS // 10
        for reply, _ in rig.at_robot(calls[number % len(calls)], desk.address).replies:
            assert len(reply) < 200
    assert len(rig.robot._greetings) == begun
    rig.down = everything
    rig.run_ms(5 * GETS_IN_MS + 600, desk)
    assert rig.gets_through(desk)

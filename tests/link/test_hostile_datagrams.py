"""Floods, recordings and nonsense at both ends: nothing changes but counters."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.ends import ANSWER, HELLO, MESSAGE, REFUSAL, TAG_BYTES, Address
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import ROBOT, Desk, Rig, connected, rtcp, rtp, spoilt

pytestmark = pytest.mark.untimed

THIEF: Address = ("203.0.113.9", 666)


@pytest.mark.parametrize("key", [b"k" * 32, b"x" * 32], ids=["recorded", "another key"])
def test_a_flood_of_calls_does_not_stop_the_operator_who_is_there(key: bytes) -> None:
    rig, desk = connected()
    for number in range(3000):
        caller = Desk(key=key, seed=number)
        for call, _ in caller.end.step(rig.now_ns):
            rig.at_robot(call, THIEF)
        if number % 60 == 0:
            rig.step(desk)
            assert rig.gets_through(desk)
    assert rig.sessions == 1
    assert rig.robot.counts["calls beyond what is looked at"] > 1000
    assert len(rig.robot._calls) <= 4


def test_few_calls_that_come_to_nothing_are_kept() -> None:
    rig = Rig()
    for number in range(100):
        rig.now_ns += NS_PER_S // 10
        for call, _ in Desk(seed=number).end.step(rig.now_ns):
            rig.at_robot(call, THIEF)
        assert len(rig.robot._calls) <= 4
    rig.run_ms(1500, desk := Desk())
    assert rig.gets_through(desk)


def test_only_so_many_calls_a_second_are_looked_at() -> None:
    rig = Rig()
    answered = 0
    for number in range(3000):
        rig.now_ns += NS_PER_S // 10_000
        call = bytes((HELLO,)) + random.Random(number).randbytes(90)
        answered += len(rig.at_robot(call, THIEF).replies)
    assert 400 <= answered <= 1000


def test_no_reply_is_longer_than_a_call_with_another_key() -> None:
    """What anyone can send must not make the robot's computer flood a third one."""
    rig = Rig()
    draw = random.Random(3)
    for length in range(200):
        rig.now_ns += NS_PER_S
        call = bytes((HELLO,)) + draw.randbytes(length)
        for reply, _ in rig.at_robot(call, THIEF).replies:
            assert len(reply) <= len(call)


def state_of(rig: Rig, desk: Desk) -> tuple[object, ...]:
    """All that a stranger must not change."""
    robot, operator = rig.robot._peer, desk.end._peer
    assert robot is not None
    assert operator is not None
    return (
        id(robot),
        robot.address,
        robot.heard_ns,
        robot._opener._newest,
        id(operator),
        operator.address,
        operator.heard_ns,
        operator._opener._newest,
        desk.end.busy,
        desk.end.refused,
        desk.end.welcome,
        desk.end.step(rig.now_ns),
        rig.sessions,
        rig.departures,
        len(rig.heard),
        len(desk.heard),
        len(rig.media),
        len(desk.media),
    )


def exchanged(rig: Rig, desk: Desk) -> list[bytes]:
    """Real datagrams of every kind and both directions that were received."""
    up = [desk.sent[0], rig.answers[0], bytes((REFUSAL,)) + desk.sent[0][1 : 1 + TAG_BYTES]]
    for number in range(20):
        for end in (desk.end, rig.robot):
            for addressed in (
                end.message(b"m" * number),
                end.media(rtp(number)),
                end.media(rtcp()),
            ):
                assert addressed is not None
                up.append(addressed[0])
    for datagram in up:
        rig.at_robot(datagram, desk.address)
        rig.at_desk(desk, datagram)
    return up


@given(st.binary(max_size=1600))
def test_any_datagram_leaves_a_session_as_it_is(nonsense: bytes) -> None:
    rig, desk = connected()
    before = state_of(rig, desk)
    rig.at_robot(nonsense, THIEF)
    rig.at_desk(desk, nonsense)
    assert state_of(rig, desk) == before
    assert rig.gets_through(desk)


def test_twenty_thousand_hostile_datagrams_leave_a_session_as_it_is() -> None:
    rig, desk = connected()
    real = exchanged(rig, desk)
    draw = random.Random(4)
    before = state_of(rig, desk)
    for number in range(20_000):
        match number % 4:
            case 0:
                datagram = draw.randbytes(draw.randrange(200))
            case 1:
                first = draw.choice((HELLO, ANSWER, MESSAGE, REFUSAL, 0x80, 0x81, 0xBF))
                datagram = bytes((first,)) + draw.randbytes(draw.randrange(200))
            case 2:
                datagram = spoilt(draw.choice(real), draw)
            case _:
                datagram = draw.choice(real)
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
        addressed = end.media(rtp(100))
        assert addressed is not None
        assert other.receive(addressed[0], desk.address, rig.now_ns).media == rtp(100)


def test_hostile_datagrams_before_a_call_begin_no_session() -> None:
    talk, caller = connected()
    real = exchanged(talk, caller)
    rig, draw = Rig(), random.Random(5)
    for number in range(5000):
        rig.now_ns += NS_PER_MS
        datagram = draw.randbytes(draw.randrange(200)) if number % 2 else draw.choice(real)
        rig.at_robot(datagram, THIEF)
        rig.at_robot(spoilt(draw.choice(real), draw), THIEF)
    assert (rig.robot.connected, rig.heard, rig.media) == (False, [], [])
    rig.run_ms(1500, caller := Desk(seed=9))
    assert rig.gets_through(caller)

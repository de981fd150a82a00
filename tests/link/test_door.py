"""Who gets in at the robot's end, who stays in, and who is told that it is busy."""

from __future__ import annotations

import os
import random
from itertools import count, pairwise

import pytest
from aioquic.quic.packet import get_retry_integrity_tag
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.addresses import Address
from tams_app.link.caller import ATTEMPT_NS, GIVE_UP_NS, REDIAL_NS, Caller
from tams_app.link.certificate import LeafKeeper
from tams_app.link.channel import GOODBYE, LET_GO_NS
from tams_app.link.door import HANDSHAKES, PROVE_NS, UNPROVEN, Door
from tams_app.link.identity import RobotIdentity
from tams_app.link.keys import LOOPBACK_KEY, Key
from tams_app.link.proof import LONGEST_INTRODUCTION_BYTES, Meeting
from tams_app.link.quic import Connection, destination_of
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    DESK,
    IDENTITY,
    KEY,
    LET_GO_MS,
    OTHER_KEY,
    ROBOT,
    STEP_NS,
    THIEF,
    UNIX_S,
    Deliver,
    Desk,
    Rig,
    channel_of,
    connected,
    everything,
    flipped,
    is_call,
    is_long,
    is_retry,
    nothing,
    robot,
    rtcp,
    rtp,
    shown,
)

pytestmark = pytest.mark.untimed

REDIAL_MS = REDIAL_NS / NS_PER_MS
AGAIN_MS = 1210  # after *busy*, with its jitter
DAY_S = 86_400.0


def other_desk(key: Key = KEY) -> Desk:
    return Desk(key, ("10.0.0.3", 40_001))


def drops(how_many: int) -> Deliver:
    """A network that loses the first so many datagrams."""
    numbers = count()
    return lambda _: next(numbers) >= how_many


# --- a call ---------------------------------------------------------------------------------------


def test_an_operator_is_connected_after_three_round_trips() -> None:
    rig, desk = Rig(), Desk()
    rig.step(desk)
    assert (desk.end.connected, rig.robot.connected, rig.sessions) == (True, True, 1)
    assert (desk.end.welcome, desk.end.busy, rig.robot.operator) == (b"welcome", False, "kim")
    assert rig.gets_through(desk)
    assert list(map(is_call, desk.sent[:3])) == [True] * 3
    assert [is_retry(answer) for answer, _ in rig.answers[:2]] == [True, False]
    assert len(desk.sent) - len(desk.heard) <= 5


@pytest.mark.parametrize("told", [b"", b"20260101-120000-operate", bytes(range(256))])
def test_the_robots_side_knows_what_the_operator_who_is_there_has_told_with_their_call(
    told: bytes,
) -> None:
    rig, desk = Rig(), Desk(introduction=told)  # without a word, as `doctor --link` calls, too
    assert rig.robot.introduction == b""
    rig.step(desk)
    assert rig.sessions == 1
    assert rig.robot.introduction == told
    rig.now_ns += 2 * LET_GO_NS
    rig.at_robot(desk.sent[0], THIEF)
    assert rig.robot.introduction == told, "a call alone does not say who is there"
    rig.step(Desk(address=("10.0.0.3", 1), introduction=b"another"))
    assert rig.robot.introduction == b"another"


@pytest.mark.parametrize("length", [0, 20, 256])
def test_the_length_of_a_call_tells_nothing_of_what_is_told_with_it(length: int) -> None:
    lengths = []
    for told in (b"", b"o" * length):
        rig, desk = Rig(), Desk(introduction=told)
        rig.step(desk)
        lengths.append([len(one) for one in desk.sent[:-1]])
    assert lengths[0] == lengths[1]


def test_what_is_too_long_to_be_told_with_a_call_is_cut_and_the_call_answered() -> None:
    rig, desk = Rig(), Desk(introduction=b"o" * 5000)
    rig.step(desk)
    assert rig.gets_through(desk)
    assert rig.robot.introduction == b"o" * LONGEST_INTRODUCTION_BYTES


def test_there_is_no_session_before_a_call() -> None:
    rig, desk = Rig(), Desk()
    for end in (rig.robot, desk.end):
        assert end.message(b"x", rig.now_ns) == end.media(rtp(1), rig.now_ns) == []
        assert end.silent_ns(rig.now_ns) is None
        assert (end.connected, end.renewals, end.address) == (False, 0, ("", 0))
    assert (rig.robot.operator, desk.end.busy) == ("", False)


@pytest.mark.parametrize("up", [True, False], ids=["calls", "answers"])
@pytest.mark.parametrize("lost", [1, 2, 3, 5])
def test_a_lost_datagram_of_a_call_is_sent_again_and_is_one_session(up: bool, lost: int) -> None:
    rig, desk = Rig(), Desk()
    if up:
        rig.up = drops(lost)
    else:
        rig.down = drops(lost)
    rig.run_ms(350 * lost + 300, desk)
    assert rig.gets_through(desk)
    assert (rig.sessions, desk.sessions) == (1, 1)


def test_an_operator_calls_at_an_even_pace_until_they_are_answered() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    called_ns: list[int] = []
    for _ in range(6000):
        before = desk.calls
        rig.step(desk)
        called_ns += [rig.now_ns] * (desk.calls > before)
    gaps_ms = [(after - before) // NS_PER_MS for before, after in pairwise(called_ns)]
    assert min(gaps_ms) >= 80
    assert max(gaps_ms) <= 250
    rig.up = everything
    rig.run_ms(500, desk)
    assert rig.gets_through(desk)


def test_a_stranger_is_not_answered_and_the_robots_side_can_say_who_called() -> None:
    rig, stranger = Rig(), Desk(key=OTHER_KEY)
    rig.run_ms(2000, stranger)
    assert rig.answers == []
    assert (stranger.end.connected, rig.robot.connected, rig.sessions) == (False, False, 0)
    assert rig.robot.counts == {"calls that no key made": stranger.calls}
    where = f"{stranger.address[0]}:{stranger.address[1]}"
    because = "is not answered: the key of who calls is not accepted here"
    assert rig.robot.refusal == f"{where} {because}"
    desk = other_desk()
    rig.run_ms(500, stranger, desk)
    assert rig.gets_through(desk)


def test_who_knows_of_a_key_but_not_its_secret_is_not_answered() -> None:
    rig, forger = Rig(), Desk(Key("kim", b"f" * 32, IDENTITY.public))
    object.__setattr__(forger.end._key, "identity", KEY.identity)
    rig.run_ms(1000, forger)
    assert rig.answers == []
    assert rig.robot.refusal == ""


def test_who_scans_the_port_is_not_answered() -> None:
    rig, draw = Rig(), random.Random(0)
    for first in range(256):
        for length in (0, 1, 5, 8, 40, 90, 1199, 1300):
            assert rig.at_robot(bytes((first,)) + draw.randbytes(length), THIEF).replies == []
            version_1 = bytes((first, 0, 0, 0, 1)) + draw.randbytes(length)
            assert rig.at_robot(version_1, THIEF).replies == []
    assert rig.at_robot(b"", THIEF).replies == []
    assert rig.robot._knocks == []


def test_a_changed_call_is_not_answered_unless_what_says_the_key_is_whole() -> None:
    rig, desk = Rig(), Desk()
    ((call, _),) = desk.end.step(rig.now_ns)
    at = call.index(KEY.identity) - 1
    for changed in flipped(call[: at + 41]):
        whole = changed + call[at + 41 :]
        answered = rig.at_robot(whole, THIEF).replies
        assert not answered or call[at : at + 41] in whole
    assert rig.robot._knocks == []


def test_an_answer_to_who_may_be_a_stranger_is_shorter_than_their_call_by_far() -> None:
    rig, desk = Rig(), Desk()
    ((call, _),) = desk.end.step(rig.now_ns)
    for _ in range(3):
        ((answer, to),) = rig.at_robot(call, THIEF).replies
        assert is_retry(answer)
        assert to == THIEF
        assert (len(call), len(answer)) == (1200, 106)  # as SAFETY says
    assert rig.robot._knocks == []


def test_before_an_address_has_answered_nothing_is_kept_of_it() -> None:
    rig = Rig()
    for number in range(200):
        for call, _ in Desk().end.step(rig.now_ns):
            assert rig.at_robot(call, ("203.0.113.9", number + 1)).replies
    assert (rig.robot._knocks, rig.robot._routes, len(rig.robot._greetings)) == ([], {}, 0)


def second_call(rig: Rig, desk: Desk) -> bytes:
    """What comes back with the answer to a first call."""
    ((call, _),) = desk.end.step(rig.now_ns)
    ((retry, _),) = rig.at_robot(call, desk.address).replies
    ((again, _),) = desk.end.receive(retry, ROBOT, rig.now_ns).replies
    return again


@pytest.mark.parametrize(
    ("later_ns", "address", "begun"),
    [
        (0, DESK, True),
        (5 * NS_PER_S, DESK, True),
        (10 * NS_PER_S, DESK, False),
        (0, (DESK[0], DESK[1] + 1), False),
        (0, THIEF, False),
    ],
)
def test_who_called_and_receives_there_may_shake_hands_for_some_seconds(
    later_ns: int, address: Address, begun: bool
) -> None:
    rig, desk = Rig(), Desk()
    again = second_call(rig, desk)
    rig.now_ns += later_ns
    assert bool(rig.at_robot(again, address).replies) == begun
    assert len(rig.robot._knocks) == begun


def test_a_call_that_was_answered_begins_nothing_when_it_is_sent_again() -> None:
    rig, desk = Rig(), Desk()
    again = second_call(rig, desk)
    assert rig.at_robot(again, desk.address).replies
    rig.now_ns += PROVE_NS
    rig.robot.step(rig.now_ns)
    assert rig.robot._knocks == []
    for _ in range(50):
        assert rig.at_robot(again, desk.address).replies == []
    assert rig.robot.counts["calls that were answered"] == 50


def test_who_recorded_a_call_and_receives_the_answer_cannot_shake_hands() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.step(desk)
    for thief in range(50):
        address = (THIEF[0], 1 + thief)
        for retry, _ in rig.at_robot(desk.sent[0], address).replies:
            echo = Connection.calling(b"anything", rig.now_ns)
            echo._quic._peer_cid.cid = destination_of(desk.sent[0])
            echo.receive(retry[:6] + echo.first_id + retry[14:], rig.now_ns)
            head = retry[:6] + echo.first_id + retry[14:-16]
            tag = get_retry_integrity_tag(head, destination_of(desk.sent[0]), 1)
            assert echo.receive(head + tag, rig.now_ns).asked
            echo.answer(os.urandom(16))
            for again in echo.datagrams(rig.now_ns):
                assert rig.at_robot(again, address).replies == []
    assert rig.robot._knocks == []
    assert rig.robot.counts["calls that no key made"] == 50
    rig.up = everything
    rig.run_ms(500, desk)
    assert rig.gets_through(desk)


@pytest.mark.parametrize("word", ["proof", "welcome"])
def test_who_begins_a_handshake_and_proves_no_key_is_not_let_in(
    monkeypatch: pytest.MonkeyPatch, word: str
) -> None:
    """On either side: what was recorded of another connection proves nothing in this one."""
    monkeypatch.setattr(Meeting, word, lambda *_: os.urandom(32))
    rig, desk = Rig(), Desk()
    rig.run_ms(500, desk)
    assert not desk.end.connected
    assert rig.robot.connected == (word == "welcome")
    assert (rig.heard, desk.heard, desk.end.welcome) == ([], [], None)


def test_who_does_not_prove_a_key_in_two_seconds_is_forgotten_without_a_word() -> None:
    rig, desk = Rig(), Desk()
    rig.at_robot(second_call(rig, desk), desk.address)
    rig.now_ns += PROVE_NS - 1
    rig.robot.step(rig.now_ns)
    assert len(rig.robot._knocks) == 1
    rig.now_ns += 1
    assert rig.robot.step(rig.now_ns) == []
    assert (rig.robot._knocks, rig.robot._routes) == ([], {})


def test_of_more_callers_than_may_shake_hands_at_a_time_the_oldest_is_forgotten() -> None:
    """Who holds a key and calls as often as they like keeps nobody with another key out."""
    keys = [Key(f"k{number}", bytes((number,)) * 32, IDENTITY.public) for number in range(12)]
    rig = Rig(robot(*keys))
    for number, key in enumerate(keys):
        desk = Desk(key, ("10.0.3.1", 1 + number))
        assert rig.at_robot(second_call(rig, desk), desk.address).replies
    assert len(rig.robot._knocks) == UNPROVEN
    assert [one.channel.address[1] for one in rig.robot._knocks] == list(range(5, 13))


def test_five_handshakes_a_second_are_begun_for_a_key() -> None:
    rig = Rig()
    begun = refused = 0
    for number in range(400):  # ten seconds
        rig.now_ns += NS_PER_S // 40
        desk = Desk(address=("10.0.3.1", 1 + number))
        if rig.at_robot(second_call(rig, desk), desk.address).replies:
            begun += 1
        else:
            refused += 1
    assert begun == 10 * HANDSHAKES
    assert rig.robot.counts == {"calls that were too many": refused}


def test_an_operator_gets_in_beside_who_floods_with_another_key() -> None:
    rig = Rig(robot(KEY, OTHER_KEY))
    for number in range(400):
        rig.now_ns += NS_PER_MS
        insider = Desk(OTHER_KEY, ("10.0.3.1", 1 + number))
        rig.at_robot(second_call(rig, insider), insider.address)
    desk = Desk()
    rig.run_ms(50, desk)
    assert rig.gets_through(desk)


def test_a_copy_of_a_callers_packets_from_elsewhere_ends_and_moves_nothing() -> None:
    """Of one who sees all packets, and whose copies are there first."""
    rig, desk = Rig(), Desk()
    raced = 0

    def race(datagram: bytes) -> bool:
        nonlocal raced
        raced += 1
        for reply, to in rig.at_robot(datagram, THIEF).replies:
            assert to == THIEF
            assert is_retry(reply) or not is_long(reply)  # nothing of a handshake
        return True

    rig.up = race
    rig.step(desk)
    rig.up = everything
    assert raced > 3
    assert rig.gets_through(desk)
    assert (rig.robot.address, rig.sessions) == (desk.address, 1)


def test_answers_to_another_call_are_not_taken() -> None:
    rig, desk = Rig(), Desk()
    rig.run_ms(50, desk)
    again = other_desk()
    rig.up = nothing
    rig.step(again)
    for recorded in desk.came:
        rig.at_desk(again, recorded)
    assert not again.end.connected
    assert set(again.end.counts) == {"without a session"}


# --- which robot it is ----------------------------------------------------------------------------


def test_another_robot_is_told_nothing_that_proves_the_key() -> None:
    stranger = RobotIdentity(b"s" * 32)
    door = Door({KEY.identity: KEY}, shown(stranger), b"welcome", os.urandom)
    rig, desk = Rig(door), Desk()
    rig.run_ms(3000, desk)
    assert (rig.sessions, desk.end.connected, desk.end.welcome) == (0, False, None)
    assert desk.end.counts["answers that are not authentic"] >= 1
    assert all(attempt.meeting is None for attempt in desk.end._attempts)


@pytest.mark.parametrize("days", [-20, 0, 15, 4000])
def test_a_robot_whose_clock_is_wrong_is_known_all_the_same(days: float) -> None:
    door = robot()
    door.leaf = LeafKeeper(IDENTITY).current(UNIX_S + days * DAY_S)
    rig, desk = Rig(door), Desk()
    rig.step(desk)
    assert rig.gets_through(desk)


def test_a_robot_that_runs_for_weeks_shows_new_certificates_and_who_is_in_stays_in() -> None:
    rig, desk = connected()
    keeper = LeafKeeper(IDENTITY)
    shown_by: set[bytes] = set()
    for day in range(16):
        rig.robot.leaf = keeper.current(UNIX_S + day * DAY_S)
        shown_by.add(rig.robot.leaf.der)
        assert rig.robot.leaf.not_after_s - (UNIX_S + day * DAY_S) > 5 * DAY_S
        rig.run_ms(20, desk)
        assert rig.gets_through(desk)
    assert len(shown_by) == 3
    rig.now_ns += LET_GO_NS
    second = other_desk()
    rig.run_ms(50, second)
    assert rig.gets_through(second)


def test_on_one_computer_no_key_is_needed() -> None:
    rig = Rig(robot(LOOPBACK_KEY))
    desk = Desk(LOOPBACK_KEY)
    rig.step(desk)
    assert rig.gets_through(desk)
    assert rig.robot.operator == ""


def test_the_name_of_nobody_can_be_read_on_the_way() -> None:
    rig, desk = Rig(), Desk(introduction=b"20260101-120000-operate")
    rig.run_ms(100, desk)
    for datagram in desk.sent + [one for one, _ in rig.answers]:
        for word in (b"kim", b"welcome", b"operate", KEY.secret, IDENTITY.public):
            assert word not in datagram


# --- keys -----------------------------------------------------------------------------------------


def test_an_operator_whose_key_is_revoked_is_let_go_at_once_and_gets_in_no_more() -> None:
    rig, desk = connected()
    heard = rig.robot.accept({OTHER_KEY.identity: OTHER_KEY}, rig.now_ns)
    assert (heard.left, rig.robot.connected, len(heard.replies)) == (True, False, 1)
    assert rig.at_desk(desk, heard.replies[0][0]).left
    before = len(rig.heard)
    rig.run_ms(20_000, desk)
    assert (len(rig.heard), rig.sessions, rig.robot.connected) == (before, 1, False)
    rig.run_ms(600, other := other_desk(OTHER_KEY))
    assert rig.gets_through(other)


def test_a_call_with_a_key_that_is_revoked_meanwhile_comes_to_nothing() -> None:
    rig, desk = Rig(), Desk()
    again = second_call(rig, desk)
    answers = rig.at_robot(again, desk.address).replies
    rig.robot.accept({OTHER_KEY.identity: OTHER_KEY}, rig.now_ns)
    rig.send_up(desk, [])
    rig.send_down(answers)
    rig.run_ms(1000, desk)
    assert (rig.sessions, rig.heard, rig.robot._knocks) == (0, [], [])


def test_of_a_silent_operator_a_revoked_key_ends_the_session_and_nothing_is_sent() -> None:
    rig, _ = connected()
    rig.now_ns += LET_GO_NS
    heard = rig.robot.accept({}, rig.now_ns)
    assert (heard.left, heard.replies, rig.robot.connected) == (True, [], False)


def test_accepting_more_keys_disturbs_nobody() -> None:
    rig, desk = connected()
    keys = {key.identity: key for key in (KEY, OTHER_KEY)}
    heard = rig.robot.accept(keys, rig.now_ns)
    assert (heard.left, heard.replies) == (False, [])
    assert rig.gets_through(desk)


# --- what was recorded ----------------------------------------------------------------------------


@pytest.mark.parametrize("later_ns", [0, LET_GO_NS, 3600 * NS_PER_S])
@pytest.mark.parametrize("address", [THIEF, Desk().address])
def test_a_recorded_session_changes_only_counters(later_ns: int, address: Address) -> None:
    rig, desk = connected()
    for packet in (rtp(1), rtp(2), rtcp()):
        rig.send_up(desk, desk.end.media(packet, rig.now_ns))
    assert len(rig.media) == 3
    rig.now_ns += later_ns
    heard, channel = list(rig.heard), channel_of(rig.robot)
    heard_ns = channel.heard_ns
    for datagram in desk.sent * 3:
        for reply, _ in rig.at_robot(datagram, address).replies:
            assert is_retry(reply)
    assert (rig.heard, len(rig.media), rig.sessions) == (heard, 3, 1)
    assert (rig.robot.message(b"state", rig.now_ns) == []) == (later_ns > 0)
    assert rig.robot._channel in (channel, None)  # after an hour its keys are worn out
    assert (channel.address, channel.heard_ns) == (desk.address, heard_ns)
    assert rig.robot.counts["late"] + rig.robot.counts["without a session"] > 0
    rig.run_ms(600, desk)  # after an hour in a session that is begun anew
    assert rig.gets_through(desk)


def test_a_session_recorded_at_another_run_of_the_robot_moves_nothing() -> None:
    _, desk = connected()
    rig = Rig()
    for datagram in desk.sent:
        rig.at_robot(datagram, desk.address)
    assert (rig.heard, rig.sessions, rig.robot.connected) == ([], 0, False)


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
    rig.run_ms(ATTEMPT_NS / NS_PER_MS + 600, desk)
    assert rig.gets_through(desk)


# --- one operator at a time -----------------------------------------------------------------------


def test_a_second_operator_is_told_that_the_first_is_there() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(10_000, first, second)
    assert (second.end.busy, second.end.connected) == (True, False)
    assert rig.sessions == 1
    assert rig.gets_through(first)
    assert 24 <= second.calls <= 39  # three datagrams a second
    assert set(rig.robot.counts) <= {"without a session"}  # what came behind its goodbye
    assert len(rig.robot._knocks) == 0, "it leaves nothing behind"


@pytest.mark.parametrize("second", [other_desk(), Desk()], ids=["another", "restarted"])
def test_a_second_operator_gets_in_when_the_first_has_let_go_and_is_the_only_one(
    second: Desk,
) -> None:
    rig, first = connected()
    rig.run_ms(LET_GO_MS - 50, second)
    assert (second.end.busy, rig.sessions) == (True, 1)
    rig.run_ms(AGAIN_MS + 50, second)
    heard = len(rig.heard)
    rig.say(first, b"from the one before")
    assert len(rig.heard) == heard
    assert rig.gets_through(second)
    assert second.end.busy is False
    if second.address != first.address:
        rig.run_ms(5000, first, second)
        assert first.end.busy is True
        assert rig.gets_through(second)
        assert rig.sessions == 2


def test_a_goodbye_makes_room_at_once() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(500, first, second)
    rig.send_up(first, first.end.goodbye(rig.now_ns))
    assert (rig.robot.connected, rig.departures) == (False, 1)
    assert GOODBYE not in rig.heard
    rig.run_ms(AGAIN_MS, second)
    assert rig.gets_through(second)


def test_after_the_robots_goodbye_the_operator_calls_again() -> None:
    rig, desk = connected()
    rig.send_down(rig.robot.goodbye(rig.now_ns))
    assert not desk.end.connected
    rig.robot = robot()  # its session has ended, and another begins
    rig.run_ms(310, desk)
    assert rig.gets_through(desk)


def test_of_two_ways_to_the_robot_one_is_taken_and_the_other_disturbs_nothing() -> None:
    rig, desk = Rig(), Desk()
    other: Address = ("10.0.9.1", 5000)
    desk.end = Caller(KEY, [ROBOT, other], os.urandom)
    for way in range(20):
        rig.now_ns += STEP_NS
        waiting = desk.end.step(rig.now_ns) if way < 10 else []
        while waiting:
            sent, waiting = waiting, []
            for datagram, to in sent:
                for reply, _ in rig.at_robot(datagram, (DESK[0], to[1])).replies:
                    waiting += desk.end.receive(reply, to, rig.now_ns).replies
    assert desk.end.connected
    assert (desk.end.busy, rig.sessions) == (False, 1)
    assert rig.robot.connected


# --- silence --------------------------------------------------------------------------------------


def test_video_alone_is_a_sign_of_life() -> None:
    rig, desk = connected()
    calls = desk.calls
    for number in range(600):
        rig.now_ns += STEP_NS
        rig.say(desk, b"hand")
        rig.send_down(rig.robot.media(rtp(number), rig.now_ns))
        rig.send_up(desk, desk.end.step(rig.now_ns))
    assert desk.calls == calls


def test_acknowledgements_are_no_sign_of_life() -> None:
    rig, desk = connected()
    rig.now_ns += LET_GO_NS // 2
    rig.tell(b"state")
    rig.now_ns += NS_PER_S // 20
    rig.send_up(desk, desk.end._timed(rig.now_ns))  # with nothing else
    rig.now_ns += LET_GO_NS // 2
    assert rig.tell(b"state") == 0


def test_a_silent_robot_is_called_again_and_the_session_goes_on_if_it_comes_back() -> None:
    rig, desk = connected()
    calls = desk.calls
    rig.down = nothing
    rig.run_ms(REDIAL_MS - 50, desk)
    assert desk.calls == calls
    rig.run_ms(3000, desk)
    assert desk.calls > calls + 5
    rig.down = everything
    rig.run_ms(20, desk)
    assert rig.gets_through(desk)
    rig.run_ms(100, desk)
    calls = desk.calls
    rig.run_ms(REDIAL_MS, desk)
    assert (rig.sessions, desk.calls) == (1, calls)


def test_a_robot_that_is_heard_again_is_not_busy() -> None:
    """The robot hears the operator, who does not hear it, and calls: another one would be busy."""
    rig, desk = connected()
    rig.down = lambda datagram: is_long(datagram) or len(datagram) not in range(500, 600)
    rig.run_ms(REDIAL_MS + 500, desk)
    busy = desk.end.busy
    rig.down = everything
    rig.run_ms(20, desk)
    assert (busy, desk.end.busy) == (True, False)
    assert rig.sessions == 1


@pytest.mark.parametrize("lost", [10, 100_000])
def test_an_operator_who_hears_nothing_any_more_gets_in_again(lost: int) -> None:
    """Also if so much was lost that the numbers of packets cannot be told any more."""
    rig, desk = connected()
    channel_of(rig.robot).connection._quic._packet_number += lost
    rig.run_ms((REDIAL_NS + GIVE_UP_NS + LET_GO_NS + ATTEMPT_NS) / NS_PER_MS, desk)
    assert rig.gets_through(desk)
    assert rig.sessions == (2 if lost > 1 << 15 else 1)


@pytest.mark.parametrize("outage_ms", [2500, 3200, 8000, 60_000])
def test_operator_and_robot_find_each_other_after_an_outage_of_any_length(outage_ms: int) -> None:
    rig, desk = connected()
    rig.up = rig.down = nothing
    rig.run_ms(outage_ms, desk)
    rig.up = rig.down = everything
    rig.run_ms(600, desk)
    assert rig.gets_through(desk)


def test_a_robot_that_was_restarted_is_found() -> None:
    rig, desk = connected()
    rig.robot = robot()
    rig.run_ms(REDIAL_MS + 310, desk)
    assert rig.gets_through(desk)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32), st.floats(0, 0.6), st.floats(0, 0.6))
def test_ends_find_each_other_through_any_loss(seed: int, up_loss: float, down_loss: float) -> None:
    rig, desk, draw = Rig(), Desk(), random.Random(seed)
    rig.up = lambda _: draw.random() >= up_loss
    rig.down = lambda _: draw.random() >= down_loss
    rig.run_ms(12_000, desk)
    rig.up = rig.down = everything
    rig.run_ms(6000, desk)
    assert rig.gets_through(desk)


# --- who calls in vain ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [0xC1, 0xC2, 0xC3, 0xC4, 0xC5])
def test_another_version_is_not_answered_and_the_robots_side_can_say_that_it_called(
    kind: int,
) -> None:
    rig, desk = Rig(), Desk()
    old = bytes((kind,)) * 1200
    assert rig.at_robot(old, THIEF).replies == desk.end.receive(old, ROBOT, 0).replies == []
    assert rig.robot.counts == {"of no known kind": 1}
    assert "another version of TAMS calls" in rig.robot.refusal
    assert rig.robot.refusal.startswith(f"{THIEF[0]}:{THIEF[1]} ")


def test_a_flood_of_strangers_makes_one_line_for_each_cause_in_ten_seconds() -> None:
    rig, lines = Rig(), set()
    call = Desk(OTHER_KEY).end.step(rig.now_ns)[0][0]
    for number in range(4000):  # a minute of calls and of what looks like protocol 1
        rig.now_ns += 15_000_000
        stranger = (f"203.0.113.{number % 200}", 1000 + number)
        rig.robot.receive(call if number % 2 else b"\xc1" * 1200, stranger, rig.now_ns)
        lines.add(rig.robot.refusal)
    assert len(lines) == 2 * 6
    assert len(rig.robot._refused_ns) == 2


def test_who_calls_on_and_on_with_another_key_makes_one_line_and_hides_no_other_caller() -> None:
    rig, lines = Rig(), list[str]()
    call = Desk(OTHER_KEY).end.step(rig.now_ns)[0][0]
    for number in range(800):  # a minute of calls from two addresses
        rig.now_ns += 75_000_000
        rig.robot.receive(call, (f"203.0.113.{number % 2}", 7300), rig.now_ns)
        lines += [rig.robot.refusal] if rig.robot.refusal not in lines[-1:] else []
    assert [line.split(" ")[0] for line in lines] == ["203.0.113.0:7300", "203.0.113.1:7300"]


def test_noise_and_cut_calls_make_no_line() -> None:
    rig, desk = Rig(), Desk(OTHER_KEY)
    call = desk.end.step(rig.now_ns)[0][0]
    for datagram in (b"", call[:-1], b"\xc0", bytes(1200), bytes((0xC9,)) * 1200):
        rig.robot.receive(datagram, THIEF, rig.now_ns)
    assert rig.robot.refusal == ""

"""What becomes of a datagram: who gets in, who stays in, and what changes nothing."""

from __future__ import annotations

import random
from itertools import count, pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.addresses import Address
from tams_app.link.ends import GOODBYE, LET_GO_NS
from tams_app.link.handshake import (
    BUSY,
    COOKIE,
    COOKIE_BYTES,
    INITIATION,
    INITIATION_BYTES,
    MAC_BYTES,
    RESPONSE,
    TAG_BYTES,
    answer,
)
from tams_app.link.operator_end import LONGEST_INTRODUCTION_BYTES, REDIAL_NS
from tams_app.link.peer import MESSAGE
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    KEY,
    LET_GO_MS,
    OTHER_KEY,
    ROBOT,
    STEP_NS,
    THIEF,
    Deliver,
    Desk,
    Rig,
    connected,
    datagram_of,
    everything,
    nothing,
    robot,
    rtcp,
    rtp,
)

pytestmark = pytest.mark.untimed

REDIAL_MS = REDIAL_NS / NS_PER_MS


def other_desk(seed: int = 1) -> Desk:
    return Desk(address=("10.0.0.3", 40_001), seed=seed)


def answered_by_hand(desk: Desk, kind: int, content: bytes) -> bytes:
    """An answer to the initiation that was sent last, by one who has the operator's key."""
    sent = desk.sent[-1]
    return answer(kind, sent[1 : 1 + TAG_BYTES], KEY, sent[-MAC_BYTES:], content)


def drops(kind: int, how_many: int) -> Deliver:
    """A network that loses the first so many datagrams of a kind."""
    numbers = count()
    return lambda datagram: datagram[0] != kind or next(numbers) >= how_many


# --- a call ---------------------------------------------------------------------------------------


def test_an_operator_is_connected_after_two_round_trips() -> None:
    rig, desk = Rig(), Desk()
    rig.step(desk)
    assert (desk.end.connected, rig.robot.connected, rig.sessions) == (True, True, 1)
    assert (desk.end.welcome, desk.end.busy, rig.robot.operator) == (b"welcome", False, "kim")
    assert rig.gets_through(desk)
    assert [answer[0] for answer in rig.answers] == [COOKIE, RESPONSE]
    assert [datagram[0] for datagram in desk.sent[:2]] == [INITIATION, INITIATION]


@pytest.mark.parametrize("told", [b"", b"20260101-120000-operate", bytes(range(256))])
def test_the_robots_side_knows_what_the_operator_who_is_there_has_told_with_their_call(
    told: bytes,
) -> None:
    rig, desk = Rig(), Desk(introduction=told)  # without a word, as `doctor --link` calls, too
    assert rig.robot.introduction == b""
    rig.step(desk)
    assert rig.sessions == 1
    assert rig.robot.introduction == told
    assert {len(one) for one in desk.sent if one[0] == INITIATION} == {INITIATION_BYTES}
    rig.now_ns += 2 * LET_GO_NS
    other = Desk(seed=1, introduction=b"another")
    rig.at_robot(desk.sent[0], THIEF)
    assert rig.robot.introduction == told, "a call alone does not say who is there"
    rig.step(other)
    assert rig.robot.introduction == b"another"


def test_what_is_too_long_to_be_told_with_a_call_is_cut_and_the_call_answered() -> None:
    rig, desk = Rig(), Desk(introduction=b"o" * 5000)
    rig.step(desk)
    assert rig.gets_through(desk)
    assert rig.robot.introduction == b"o" * LONGEST_INTRODUCTION_BYTES


def test_there_is_no_session_before_a_call() -> None:
    rig, desk = Rig(), Desk()
    for end in (rig.robot, desk.end):
        assert end.message(b"x", rig.now_ns) is end.media(rtp(1), rig.now_ns) is None
        assert end.silent_ns(rig.now_ns) is None
        assert (end.connected, end.renewals) == (False, 0)
    assert (rig.robot.operator, desk.end.busy) == ("", False)


@pytest.mark.parametrize("kind", [INITIATION, COOKIE, RESPONSE])
@pytest.mark.parametrize("lost", [1, 5])
def test_a_lost_datagram_of_a_call_is_sent_again_and_is_one_session(kind: int, lost: int) -> None:
    rig, desk = Rig(), Desk()
    rig.up = rig.down = drops(kind, lost)
    rig.run_ms(190 * lost, desk)
    assert not desk.end.connected
    rig.run_ms(120 * lost, desk)
    assert rig.gets_through(desk)
    assert (rig.sessions, desk.sessions, desk.calls) == (1, 1, lost + 1)
    answers = [answer for answer in rig.answers if answer[0] == kind]
    assert len(answers) == (0 if kind == INITIATION else lost + 1)
    assert len(set(answers)) <= 1


def test_an_operator_calls_until_they_are_answered() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.run_ms(60_000, desk)
    assert 210 <= desk.calls <= 260
    assert len(set(desk.sent)) == 12  # each attempt has keys of its own
    rig.up = everything
    rig.run_ms(310, desk)
    assert rig.gets_through(desk)


def test_initiations_keep_step_with_nothing() -> None:
    rig, desk = Rig(), Desk()
    sent_ns: list[int] = []
    for _ in range(60_000):
        rig.now_ns += NS_PER_MS
        sent_ns += [rig.now_ns] * len(desk.end.step(rig.now_ns))
    gaps_ms = [(after - before) // NS_PER_MS for before, after in pairwise(sent_ns)]
    assert 200 <= min(gaps_ms) <= 215
    assert 285 <= max(gaps_ms) <= 301
    assert len(set(gaps_ms)) > 50


def test_a_stranger_is_not_answered_and_the_robots_side_can_say_who_called() -> None:
    rig, stranger = Rig(), Desk(key=OTHER_KEY)
    rig.run_ms(2000, stranger)
    assert rig.answers == []
    assert (stranger.end.connected, rig.robot.connected, rig.sessions) == (False, False, 0)
    assert rig.robot.counts == {"initiations that no key made": stranger.calls}
    where = f"{stranger.address[0]}:{stranger.address[1]}"
    because = "is not answered: the key of who calls is not accepted here"
    assert rig.robot.refusal == f"{where} {because}"
    desk = other_desk()
    rig.run_ms(1500, stranger, desk)
    assert rig.gets_through(desk)


def test_who_scans_the_port_is_not_answered() -> None:
    rig, draw = Rig(), random.Random(0)
    for first in range(256):
        for length in (0, 1, 8, 40, 90, 1199):
            assert rig.at_robot(bytes((first,)) + draw.randbytes(length), THIEF).replies == []
    assert rig.at_robot(b"", THIEF).replies == []


def test_no_answer_is_longer_than_the_initiation_that_it_answers() -> None:
    rig, desk = Rig(), Desk()
    longest = 0
    rig.up = nothing
    for _ in range(40):
        rig.step(desk)
    initiations = [datagram for datagram in desk.sent if datagram[0] == INITIATION]
    for datagram in initiations:
        for reply, _ in rig.at_robot(datagram, THIEF).replies:
            longest = max(longest, len(reply))
            assert reply[0] == COOKIE
    assert 0 < longest < 50
    rig.up = everything
    rig.run_ms(400, desk)
    assert max(map(len, rig.answers[:2])) <= len(initiations[0])


def test_before_an_address_has_answered_nothing_is_kept_of_it() -> None:
    rig = Rig()
    for number in range(200):
        for call, _ in Desk(seed=number).end.step(rig.now_ns):
            rig.at_robot(call, ("203.0.113.9", number + 1))
    assert len(rig.robot._calls) == 0


@pytest.mark.parametrize("kind", [COOKIE, BUSY, RESPONSE])
def test_forged_answers_to_each_initiation_keep_no_operator_out(kind: int) -> None:
    """Of one who sees all initiations, and is faster than the robot's side."""
    rig, desk, draw = Rig(), Desk(), random.Random(kind)
    forged = 0

    def race(datagram: bytes) -> bool:
        nonlocal forged
        if datagram[0] == INITIATION:
            for size in (16, 40, 1191):
                tag = datagram[1 : 1 + TAG_BYTES]
                rig.at_desk(desk, bytes((kind,)) + tag + draw.randbytes(size))
                forged += 1
        return True

    rig.up = race
    rig.step(desk)
    assert rig.gets_through(desk)
    assert desk.end.counts == {"answers that are not authentic": forged}
    assert desk.end.busy is False


def test_an_answer_to_another_initiation_is_not_taken() -> None:
    rig, desk = Rig(), Desk()
    rig.run_ms(50, desk)
    again = other_desk(seed=3)
    rig.up = nothing
    rig.step(again)
    for recorded in rig.answers:
        rig.at_desk(again, recorded)
        with_its_tag = recorded[:1] + again.sent[0][1 : 1 + TAG_BYTES] + recorded[1 + TAG_BYTES :]
        rig.at_desk(again, with_its_tag)
    assert not again.end.connected
    assert again.end.counts == {"answers that are not authentic": 4}


def test_a_cookie_is_sent_back_at_once_if_it_is_another_and_is_one() -> None:
    """A robot's side that gives the same cookie again and again starts no exchange without end."""
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.step(desk)
    for cookie in (b"", b"c" * (COOKIE_BYTES - 1), b"c" * (COOKIE_BYTES + 1)):
        assert rig.at_desk(desk, answered_by_hand(desk, COOKIE, cookie)).replies == []
    for cookie in (b"c" * COOKIE_BYTES, b"d" * COOKIE_BYTES):
        ((again, _),) = rig.at_desk(desk, answered_by_hand(desk, COOKIE, cookie)).replies
        assert cookie in again
        assert rig.at_desk(desk, answered_by_hand(desk, COOKIE, cookie)).replies == []
    assert desk.end.counts == {}


def test_an_answer_whose_mac_is_right_and_whose_keys_are_none_is_not_taken() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.step(desk)
    for number, content in enumerate((b"", b"c" * 47, b"c" * 48, b"c" * 1000), 1):
        heard = rig.at_desk(desk, answered_by_hand(desk, RESPONSE, content))
        assert not heard.connected
        assert desk.end.counts == {"answers that are not authentic": number}
    rig.up = everything
    rig.run_ms(310, desk)
    assert rig.gets_through(desk)


def test_one_initiation_is_answered_forty_times() -> None:
    """So often an operator sends it in vain in five seconds at most; the others are recordings."""
    rig, desk = Rig(), Desk()
    rig.up = lambda datagram: datagram[0] == INITIATION
    rig.step(desk)
    call, first = desk.sent[1], rig.answers[-1]
    assert first[0] == RESPONSE
    replies = [rig.at_robot(call, desk.address).replies for _ in range(50)]
    assert replies == [[(first, desk.address)]] * 39 + [[]] * 11
    assert rig.robot.counts == {"initiations that were answered": 11}
    rig.up = everything
    assert rig.gets_through(desk)


def test_of_more_calls_than_are_kept_the_oldest_is_forgotten() -> None:
    """512 are kept: who holds a key and takes all places keeps nobody out."""
    rig = Rig()
    rig.up = lambda datagram: datagram[0] == INITIATION
    desks = [Desk(address=("10.0.3.1", number // 8), seed=number) for number in range(8, 521)]
    for desk in desks:
        for call, _ in desk.end.step(rig.now_ns):
            rig.send_up(desk, call)
    rig.up = everything
    rig.say(desks[0], b"of the oldest")
    assert rig.heard == []
    rig.say(desks[1], b"of the second")
    assert rig.heard == [b"of the second"]
    rig.now_ns += LET_GO_NS
    rig.say(desks[-1], b"of the newest")
    assert rig.heard == [b"of the second", b"of the newest"]


# --- what changes nothing -------------------------------------------------------------------------


def test_what_is_no_packet_of_media_is_not_sent() -> None:
    rig, desk = connected()
    for end in (rig.robot, desk.end):
        for packet in (b"", b"\x80", rtp(1, size=1500), bytes(40)):
            assert end.media(packet, rig.now_ns) is None


@pytest.mark.parametrize(
    ("at_robot", "handshake", "reason"),
    [
        (True, [bytes((INITIATION,)) + bytes(1199)], "initiations that no key made"),
        (
            False,
            [bytes((one,)) + bytes(24) for one in (COOKIE, BUSY, RESPONSE)],
            "answers to no call",
        ),
    ],
    ids=["robot", "operator"],
)
def test_what_changes_nothing_is_counted_by_its_reason(
    at_robot: bool, handshake: list[bytes], reason: str
) -> None:
    rig, desk = Rig(), Desk()
    end = rig.robot if at_robot else desk.end

    def comes(datagram: bytes) -> None:
        if at_robot:
            rig.at_robot(datagram, desk.address)
        else:
            rig.at_desk(desk, datagram)

    forged = bytes((MESSAGE,)) + bytes(100)
    for number in (1, 2):
        for datagram in (forged, rtp(number), b"", b"\x7fx", *handshake):
            comes(datagram)
        counts = {"without a session": 2 * number, "of no known kind": 2 * number}
        assert end.counts == {**counts, reason: len(handshake) * number}
    rig.run_ms(50, desk)
    end.counts.clear()
    other = desk.end if at_robot else rig.robot
    last = datagram_of(other.message(b"the last one", rig.now_ns))
    changed = last[:-1] + bytes((last[-1] ^ 1,))
    comes(last)
    for number in (1, 2, 3):
        for datagram in (last, last, changed, forged, rtp(number) + bytes(16)):
            comes(datagram)
        assert end.counts == {
            "late": 2 * number,
            "not authentic": 2 * number,
            "media not authentic": number,
        }


# --- keys -----------------------------------------------------------------------------------------


def test_an_operator_whose_key_is_revoked_is_let_go_at_once_and_gets_in_no_more() -> None:
    rig, desk = connected()
    heard = rig.robot.accept({OTHER_KEY.identity: OTHER_KEY}, rig.now_ns)
    assert (heard.left, rig.robot.connected, len(heard.replies)) == (True, False, 1)
    assert rig.at_desk(desk, heard.replies[0][0]).left
    before = len(rig.heard)
    rig.run_ms(20_000, desk)
    assert (len(rig.heard), rig.sessions, rig.robot.connected) == (before, 1, False)
    rig.run_ms(600, other := Desk(key=OTHER_KEY, address=("10.0.0.3", 1)))
    assert rig.gets_through(other)


def test_a_call_with_a_key_that_is_revoked_meanwhile_comes_to_nothing() -> None:
    rig, desk = Rig(), Desk()
    rig.up = drops(MESSAGE, 10)
    rig.step(desk)
    assert desk.end.connected
    rig.robot.accept({OTHER_KEY.identity: OTHER_KEY}, rig.now_ns)
    rig.run_ms(1000, desk)
    assert (rig.sessions, rig.heard) == (0, [])


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
        rig.send_up(desk, datagram_of(desk.end.media(packet, rig.now_ns)))
    assert len(rig.media) == 3
    rig.now_ns += later_ns
    heard, peer = list(rig.heard), rig.robot._peer
    assert peer is not None
    heard_ns = peer.heard_ns
    for datagram in desk.sent * 3:
        rig.at_robot(datagram, address)
    assert rig.heard == heard
    assert len(rig.media) == 3
    assert rig.sessions == 1
    assert (rig.robot.message(b"state", rig.now_ns) is None) == (later_ns > 0)
    assert rig.robot._peer in (peer, None)  # after an hour its keys are worn out
    assert (peer.address, peer.heard_ns) == (desk.address, heard_ns)
    assert rig.robot.counts["late"] + rig.robot.counts["without a session"] > 0
    rig.run_ms(300, desk)  # after an hour in a session that is begun anew
    assert rig.gets_through(desk)


def test_a_session_recorded_at_another_run_of_the_robot_moves_nothing() -> None:
    _, desk = connected()
    rig = Rig()
    for datagram in desk.sent:
        rig.at_robot(datagram, desk.address)
    assert (rig.heard, rig.sessions, rig.robot.connected) == ([], 0, False)


def test_a_call_that_came_to_nothing_is_void_after_a_while() -> None:
    """Otherwise its recording could take the operator's place for a moment, hours later."""
    rig, desk, late = Rig(), Desk(), other_desk()
    for one in (desk, late):  # both are answered: no operator is there yet
        for call, _ in one.end.step(rig.now_ns):
            rig.send_up(one, call)
    assert late.end.connected
    rig.say(desk, b"first")
    rig.say(late, b"second")
    assert (rig.heard, late.end.connected) == ([b"first"], True)
    recorded = list(late.sent)
    rig.run_ms(11_000, desk)
    rig.now_ns += LET_GO_NS
    for datagram in recorded[::-1] * 2:
        rig.at_robot(datagram, THIEF)
    assert (rig.sessions, rig.heard[-1]) == (1, b"hand")


# --- one operator at a time -----------------------------------------------------------------------


def test_a_second_operator_is_told_that_the_first_is_there() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(10_000, first, second)
    assert (second.end.busy, second.end.connected) == (True, False)
    assert rig.sessions == 1
    assert rig.gets_through(first)
    assert {len(one) for one in rig.answers if one[0] == BUSY} == {1 + TAG_BYTES + MAC_BYTES}
    assert second.calls <= 51
    assert (rig.robot.counts, len(rig.robot._calls)) == ({}, 0), "it leaves nothing behind"


@pytest.mark.parametrize("second", [other_desk(), Desk(seed=5)], ids=["another", "restarted"])
def test_a_second_operator_gets_in_when_the_first_has_let_go_and_is_the_only_one(
    second: Desk,
) -> None:
    rig, first = connected()
    rig.run_ms(LET_GO_MS - 50, second)
    assert (second.end.busy, rig.sessions) == (True, 1)
    rig.run_ms(400, second)
    heard = len(rig.heard)
    rig.say(first, b"from the one before")
    assert len(rig.heard) == heard
    assert rig.gets_through(second)
    assert second.end.busy is False
    rig.run_ms(5000, first, second)
    assert first.end.busy is True
    assert rig.gets_through(second)
    assert rig.sessions == 2


def test_a_goodbye_makes_room_at_once() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(500, first, second)
    rig.say(first, GOODBYE)
    assert (rig.robot.connected, rig.departures) == (False, 1)
    assert GOODBYE not in rig.heard
    rig.run_ms(310, second)
    assert rig.gets_through(second)


def test_a_caller_who_leaves_before_they_are_the_operator_takes_nothing_from_the_one_who_was() -> (
    None
):
    rig, first = connected()
    rig.run_ms(LET_GO_MS + 100)  # the first one's way is cut for longer than the place is held
    second = other_desk()
    for call, _ in second.end.step(rig.now_ns):
        rig.send_up(second, call)
    rig.say(second, GOODBYE)
    assert rig.departures == 0
    assert rig.gets_through(first)


def test_after_the_robots_goodbye_the_operator_calls_again() -> None:
    rig, desk = connected()
    assert rig.tell(desk, GOODBYE)
    assert not desk.end.connected
    rig.robot = robot()  # its session has ended, and another begins
    rig.run_ms(310, desk)
    assert rig.gets_through(desk)


# --- silence --------------------------------------------------------------------------------------


def test_video_alone_is_a_sign_of_life() -> None:
    rig, desk = connected()
    for number in range(600):
        rig.now_ns += STEP_NS
        rig.say(desk, b"hand")
        rig.at_desk(desk, datagram_of(rig.robot.media(rtp(number), rig.now_ns)))
        assert desk.end.step(rig.now_ns) == []


def test_a_silent_robot_is_called_again_and_the_session_goes_on_if_it_comes_back() -> None:
    rig, desk = connected()
    rig.down = nothing
    rig.run_ms(REDIAL_MS - 50, desk)
    assert desk.calls == 1
    rig.run_ms(3000, desk)
    assert desk.calls > 5
    rig.down = everything
    rig.run_ms(20, desk)
    assert rig.gets_through(desk)
    calls = desk.calls
    rig.run_ms(REDIAL_MS, desk)
    assert (rig.sessions, desk.calls) == (1, calls)


def test_a_robot_that_is_heard_again_is_not_busy() -> None:
    """The robot hears the operator, who does not hear it, and calls: another one would be busy."""
    rig, desk = connected()
    rig.down = lambda datagram: datagram[0] in (COOKIE, BUSY)
    rig.run_ms(REDIAL_MS + 500, desk)
    busy = desk.end.busy
    rig.down = everything
    rig.run_ms(20, desk)
    assert (busy, desk.end.busy) == (True, False)
    assert rig.sessions == 1


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


@settings(max_examples=15)
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


@pytest.mark.parametrize("kind", [0xC1, 0xC2, 0xC3, 0xC4])
def test_another_version_is_not_answered_and_the_robots_side_can_say_that_it_called(
    kind: int,
) -> None:
    rig, desk = Rig(), Desk()
    old = bytes((kind,)) * 92
    assert rig.at_robot(old, THIEF).replies == desk.end.receive(old, ROBOT, 0).replies == []
    assert rig.robot.counts == desk.end.counts == {"of no known kind": 1}
    assert "another version of TAMS calls" in rig.robot.refusal
    assert rig.robot.refusal.startswith(f"{THIEF[0]}:{THIEF[1]} ")


def test_a_flood_of_strangers_makes_one_line_for_each_cause_in_ten_seconds() -> None:
    rig, lines = Rig(), set()
    other = Desk(OTHER_KEY)
    call = other.end.step(rig.now_ns)[0][0]
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


def test_noise_and_cut_initiations_make_no_line() -> None:
    rig, desk = Rig(), Desk(OTHER_KEY)
    call = desk.end.step(rig.now_ns)[0][0]
    for datagram in (b"", call[:-1], b"\xc5", bytes(1200), bytes((0xC9,)) * 1200):
        rig.robot.receive(datagram, THIEF, rig.now_ns)
    assert rig.robot.refusal == ""

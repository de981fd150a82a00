"""What becomes of a datagram: who gets in, who stays in, and what changes nothing."""

from __future__ import annotations

import random
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.ends import (
    ANSWER,
    GOODBYE,
    HELLO,
    LET_GO_NS,
    MESSAGE,
    REDIAL_NS,
    REFUSAL,
    TAG_BYTES,
    Address,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    STEP_NS,
    Deliver,
    Desk,
    Rig,
    connected,
    everything,
    nothing,
    rtcp,
    rtp,
    spoilt,
)

pytestmark = pytest.mark.untimed

THIEF: Address = ("203.0.113.9", 666)
LET_GO_MS = LET_GO_NS / NS_PER_MS
REDIAL_MS = REDIAL_NS / NS_PER_MS


def other_desk(seed: int = 1) -> Desk:
    return Desk(address=("10.0.0.3", 40_001), seed=seed)


def drops(kind: int, how_many: int) -> Deliver:
    """A network that loses the first so many datagrams of a kind."""
    numbers = count()
    return lambda datagram: datagram[0] != kind or next(numbers) >= how_many


# --- a call ---------------------------------------------------------------------------------------


def test_an_operator_is_connected_at_once() -> None:
    rig, desk = Rig(), Desk()
    rig.step(desk)
    assert (desk.end.connected, rig.robot.connected, rig.sessions) == (True, True, 1)
    assert (desk.end.welcome, desk.end.busy, desk.end.refused) == (b"welcome", False, False)
    assert rig.gets_through(desk)
    assert desk.calls == 1


def test_there_is_no_session_before_a_call() -> None:
    rig, desk = Rig(), Desk()
    assert rig.robot.message(b"x") is desk.end.message(b"x") is None
    assert rig.robot.media(rtp(1)) is desk.end.media(rtp(1)) is None
    assert rig.robot.silent_ns(rig.now_ns) is None


@pytest.mark.parametrize("lost", [1, 5])
def test_a_lost_hello_is_sent_again(lost: int) -> None:
    rig, desk = Rig(), Desk()
    rig.up = drops(HELLO, lost)
    rig.run_ms(250 * lost, desk)
    assert not desk.end.connected
    rig.run_ms(30, desk)
    assert rig.gets_through(desk)
    assert desk.calls == lost + 1


@pytest.mark.parametrize("lost", [1, 5])
def test_a_lost_answer_is_sent_again_and_is_one_call(lost: int) -> None:
    rig, desk = Rig(), Desk()
    rig.down = drops(ANSWER, lost)
    rig.run_ms(250 * lost + 30, desk)
    assert rig.gets_through(desk)
    assert rig.sessions == 1
    assert len(rig.answers) == lost + 1
    assert len(set(rig.answers)) == 1


def test_lost_first_messages_do_not_end_the_call() -> None:
    rig, desk = Rig(), Desk()
    rig.up = drops(MESSAGE, 50)
    rig.run_ms(520, desk)
    assert rig.gets_through(desk)
    assert desk.calls == 1


def test_an_operator_calls_until_they_are_answered() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.run_ms(60_000, desk)
    assert 230 <= desk.calls <= 240
    assert len(set(desk.sent)) == 12  # each attempt has keys of its own
    rig.up = everything
    rig.run_ms(260, desk)
    assert rig.gets_through(desk)


def test_another_key_is_told_and_changes_nothing_else() -> None:
    rig, stranger = Rig(), Desk(key=b"x" * 32)
    rig.run_ms(2000, stranger)
    assert (stranger.end.refused, stranger.end.connected, rig.robot.connected) == (
        True,
        False,
        False,
    )
    assert rig.sessions == 0
    assert set(rig.robot.counts) == {"calls with another key"}
    assert all(answer[0] == REFUSAL for answer in rig.answers)
    desk = other_desk()
    rig.run_ms(1500, stranger, desk)
    assert rig.gets_through(desk)


def test_a_forged_refusal_is_not_believed() -> None:
    rig, desk = Rig(), Desk()
    rig.up = nothing
    rig.step(desk)
    rig.at_desk(desk, bytes((REFUSAL,)) + bytes(TAG_BYTES))
    assert not desk.end.refused
    rig.up = everything
    rig.run_ms(300, desk)
    rig.at_desk(desk, bytes((REFUSAL,)) + desk.sent[0][1 : 1 + TAG_BYTES])
    assert not desk.end.refused  # there is a session: what holds no key can say what it likes
    assert rig.gets_through(desk)


def test_a_robot_with_another_key_is_not_believed() -> None:
    rig, desk = Rig(), Desk()
    impostor = Rig()
    rig.up = nothing
    rig.step(desk)
    tag = desk.sent[0][1 : 1 + TAG_BYTES]
    theirs = Desk(key=b"x" * 32)
    impostor.step(theirs)
    rig.at_desk(desk, bytes((ANSWER,)) + tag + random.Random(0).randbytes(80))
    assert not desk.end.connected
    assert desk.end.counts == {"answers with another key": 1}
    rig.up = everything
    rig.run_ms(300, desk)
    assert rig.gets_through(desk)


def test_an_answer_to_another_call_does_not_void_this_one() -> None:
    rig, desk = Rig(), Desk()
    rig.down = nothing
    rig.step(desk)
    rig.at_desk(desk, bytes((ANSWER,)) + bytes(TAG_BYTES) + bytes(80))
    assert desk.end.counts == {"answers to no call": 1}
    rig.at_desk(desk, rig.answers[0])
    rig.down = everything
    assert rig.gets_through(desk)


# --- what was recorded ----------------------------------------------------------------------------


def test_a_recorded_call_does_not_displace_the_operator() -> None:
    rig, desk = connected()
    for address in (THIEF, desk.address):
        for _ in range(3):
            rig.at_robot(desk.sent[0], address)
            assert rig.gets_through(desk)
    assert rig.sessions == 1


def test_a_recorded_call_is_no_way_in_when_the_operator_has_gone() -> None:
    rig, desk = connected()
    rig.now_ns += 10 * LET_GO_NS
    for datagram in desk.sent * 3:
        rig.at_robot(datagram, THIEF)
    assert rig.sessions == 1
    addressed = rig.robot.message(b"state")
    assert addressed is not None
    assert addressed[1] == desk.address


@pytest.mark.parametrize("later_ns", [0, LET_GO_NS, 3600 * NS_PER_S])
@pytest.mark.parametrize("address", [THIEF, Desk().address])
def test_a_recorded_session_changes_only_counters(later_ns: int, address: Address) -> None:
    rig, desk = connected()
    media = [desk.end.media(packet) for packet in (rtp(1), rtp(2), rtcp())]
    for addressed in media:
        assert addressed is not None
        rig.send_up(desk, addressed[0])
    assert len(rig.media) == 3
    rig.now_ns += later_ns
    heard, peer = list(rig.heard), rig.robot._peer
    assert peer is not None
    heard_ns = peer.heard_ns
    for datagram in desk.sent:
        rig.at_robot(datagram, address)
    assert rig.heard == heard
    assert len(rig.media) == 3
    assert rig.sessions == 1
    assert rig.robot._peer is peer
    assert (peer.address, peer.heard_ns) == (desk.address, heard_ns)
    assert rig.robot.counts["late"] + rig.robot.counts["not authentic"] > 0
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
    rig.say(desk, b"first")
    rig.say(late, b"second")
    assert (rig.heard, late.end.connected) == ([b"first"], True)
    recorded = list(late.sent)
    rig.run_ms(11_000, desk)
    rig.now_ns += LET_GO_NS
    for datagram in recorded[::-1] * 2:
        rig.at_robot(datagram, THIEF)
    assert (rig.sessions, rig.heard[-1]) == (1, b"hand")


def test_the_answer_of_a_recorded_session_is_not_taken() -> None:
    rig, desk = Rig(), Desk()
    rig.run_ms(50, desk)
    again = Desk()  # the same tag, as if chance had drawn it twice
    rig.up = nothing
    rig.step(again)
    assert again.sent[0][: 1 + TAG_BYTES] == desk.sent[0][: 1 + TAG_BYTES]
    rig.at_desk(again, rig.answers[0])
    assert not again.end.connected
    assert again.end.counts["answers with another key"] == 1


# --- one operator at a time -----------------------------------------------------------------------


def test_a_second_operator_is_told_that_the_first_is_there() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(10_000, first, second)
    assert (second.end.busy, second.end.connected, second.end.refused) == (True, False, False)
    assert rig.sessions == 1
    assert rig.gets_through(first)


def test_operators_who_wait_do_not_use_up_the_calls_of_others() -> None:
    """An answer that comes to nothing is followed by the next call after its time, not at once."""
    rig, first = connected()
    second = other_desk()
    rig.run_ms(10_000, first, second)
    assert second.calls <= 41
    assert rig.robot.counts == {}


def test_a_second_operator_gets_in_when_the_first_has_let_go() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(LET_GO_MS - 50, second)
    assert (second.end.busy, rig.sessions) == (True, 1)
    rig.run_ms(350, second)
    assert rig.gets_through(second)
    assert second.end.busy is False
    rig.run_ms(5000, first, second)
    assert first.end.busy is True
    assert rig.gets_through(second)
    assert rig.sessions == 2


def test_the_robot_hears_only_the_operator_who_is_there() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(LET_GO_MS + 300, second)
    heard = len(rig.heard)
    rig.say(first, b"from the one before")
    assert len(rig.heard) == heard
    assert rig.gets_through(second)


def test_a_goodbye_makes_room_at_once() -> None:
    rig, first = connected()
    second = other_desk()
    rig.run_ms(500, first, second)
    rig.say(first, GOODBYE)
    assert (rig.robot.connected, rig.departures) == (False, 1)
    assert GOODBYE not in rig.heard
    rig.run_ms(300, second)
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
    rig.robot = Rig().robot  # its session has ended, and another begins
    rig.run_ms(300, desk)
    assert rig.gets_through(desk)


def test_an_operator_whose_computer_was_restarted_gets_in_when_the_former_session_is_silent() -> (
    None
):
    rig, _ = connected()
    again = Desk(seed=5)
    rig.run_ms(LET_GO_MS - 50, again)
    assert again.end.busy
    rig.run_ms(350, again)
    assert rig.gets_through(again)


# --- silence --------------------------------------------------------------------------------------


def test_a_robot_that_is_heard_is_not_called_again() -> None:
    rig, desk = connected()
    rig.run_ms(60_000, desk)
    assert desk.calls == 1


def test_video_alone_is_a_sign_of_life() -> None:
    rig, desk = connected()
    for number in range(600):
        rig.now_ns += STEP_NS
        addressed = rig.robot.media(rtp(number))
        assert addressed is not None
        rig.at_desk(desk, addressed[0])
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
    rig.down = lambda datagram: datagram[0] == ANSWER
    rig.run_ms(REDIAL_MS + 500, desk)
    assert desk.end.busy
    rig.down = everything
    rig.run_ms(20, desk)
    assert not desk.end.busy
    assert rig.sessions == 1


def test_a_session_goes_on_after_an_outage_of_both_directions() -> None:
    rig, desk = connected()
    rig.up = rig.down = nothing
    rig.run_ms(LET_GO_MS - 500, desk)
    rig.up = rig.down = everything
    rig.run_ms(20, desk)
    assert rig.gets_through(desk)
    assert rig.sessions == 1


def test_a_session_that_is_heard_again_is_no_new_one() -> None:
    rig, desk = connected()
    rig.now_ns += LET_GO_NS
    assert rig.gets_through(desk)
    assert rig.sessions == 1


@pytest.mark.parametrize("outage_ms", [2500, 3200, 8000, 60_000])
def test_operator_and_robot_find_each_other_after_an_outage_of_any_length(outage_ms: int) -> None:
    rig, desk = connected()
    rig.up = rig.down = nothing
    rig.run_ms(outage_ms, desk)
    rig.up = rig.down = everything
    rig.run_ms(600, desk)
    assert rig.gets_through(desk)


@pytest.mark.parametrize("goodbye_arrives", [True, False])
def test_video_is_authentic_again_after_an_outage_in_which_its_index_was_lost(
    goodbye_arrives: bool,
) -> None:
    """Only what the robot sends is lost: it still hears its operator, and so does not let go."""
    rig, desk = connected()
    rig.down = nothing
    packets_a_second = 1000
    for second in range(40):  # more than half of all numbers
        for sequence in range(packets_a_second):
            rig.robot.media(rtp(second * packets_a_second + sequence))
        rig.run_ms(1000, desk)
    rig.down = everything
    rig.up = everything if goodbye_arrives else drops(MESSAGE, 1)
    rig.run_ms(600 if goodbye_arrives else LET_GO_MS + 600, desk)
    assert rig.sessions == 2
    assert rig.gets_through(desk)
    packet = rtp(40 * packets_a_second)
    media = rig.robot.media(packet)
    assert media is not None
    assert rig.at_desk(desk, media[0]).media == packet


def test_a_robot_that_was_restarted_is_found() -> None:
    rig, desk = connected()
    rig.robot = Rig().robot
    rig.run_ms(REDIAL_MS + 300, desk)
    assert rig.gets_through(desk)


@settings(max_examples=30)
@given(st.integers(0, 2**32), st.floats(0, 0.6), st.floats(0, 0.6))
def test_ends_find_each_other_through_any_loss(seed: int, up_loss: float, down_loss: float) -> None:
    rig, desk, draw = Rig(), Desk(), random.Random(seed)
    rig.up = lambda _: draw.random() >= up_loss
    rig.down = lambda _: draw.random() >= down_loss
    rig.run_ms(12_000, desk)
    rig.up = rig.down = everything
    rig.run_ms(6000, desk)
    assert rig.gets_through(desk)


# --- who moves ------------------------------------------------------------------------------------


def test_an_operator_who_moves_to_another_address_is_followed() -> None:
    rig, desk = connected()
    desk.address = ("192.168.7.7", 1234)
    assert not rig.tell(desk, b"state")
    assert rig.gets_through(desk)


def test_only_a_newer_message_moves_the_session() -> None:
    rig, desk = connected()
    overtaken, newest = desk.end.message(b"older"), desk.end.message(b"newer")
    media = desk.end.media(rtp(1))
    assert overtaken is not None
    assert newest is not None
    assert media is not None
    rig.at_robot(newest[0], desk.address)
    draw = random.Random(0)
    for datagram in (overtaken[0], newest[0], media[0], desk.sent[0], spoilt(newest[0], draw)):
        rig.at_robot(datagram, THIEF)
        addressed = rig.robot.message(b"state")
        assert addressed is not None
        assert addressed[1] == desk.address
    assert rig.gets_through(desk)

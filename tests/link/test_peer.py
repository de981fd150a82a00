"""While there is a session: new keys without a gap, consent to receive, and who moves where."""

from __future__ import annotations

import random
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.addresses import Address
from tams_app.link.ends import (
    ATTEMPT_NS,
    LET_GO_NS,
    OUTWORN_NS,
    QUESTION,
    REKEY,
    REKEYED,
    RobotEnd,
)
from tams_app.link.operator_end import REFUSED_NS, REKEY_NS
from tams_app.link.peer import OVERLAP_NS
from tams_app.link.sealing import HAND_BYTES, LINK_BYTES, STATE_BYTES, sealed_bytes
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    LET_GO_MS,
    ROBOT,
    STEP_NS,
    THIEF,
    Desk,
    Rig,
    connected,
    datagram_of,
    everything,
    nothing,
    rtcp,
    rtp,
    spoilt,
)

pytestmark = pytest.mark.untimed

ELSEWHERE: Address = ("192.168.7.7", 1234)
SECOND_MS = 1000.0
REFUSED_MS = REFUSED_NS / NS_PER_MS


def shown(rig: Rig, desk: Desk, packet: bytes) -> bytes | None:
    """What the operator gets of a packet that the robot's side sends them."""
    addressed = rig.robot.media(packet, rig.now_ns)
    if addressed is None or addressed[1] != desk.address or not rig.down(addressed[0]):
        return None
    return rig.at_desk(desk, addressed[0]).media


def pass_s(rig: Rig, desk: Desk, seconds: int) -> None:
    """While both sides say something once a second."""
    for _ in range(seconds):
        rig.now_ns += NS_PER_S - STEP_NS
        rig.step(desk)


def let_keys_age(rig: Rig, desk: Desk) -> None:
    """Until a second before new ones are due."""
    pass_s(rig, desk, REKEY_NS // NS_PER_S - 1)


def sent_to(rig: Rig) -> Address | None:
    """Where the robot's side sends now."""
    addressed = rig.robot.message(b"state", rig.now_ns)
    return None if addressed is None else addressed[1]


# --- new keys -------------------------------------------------------------------------------------


def test_the_keys_of_a_session_are_replaced_every_two_minutes_and_nothing_is_lost() -> None:
    rig, desk = connected()
    heard, told, sequence = len(rig.heard), len(desk.heard), count(1)
    steps = round(8 * 60 * NS_PER_S / STEP_NS)
    for _ in range(steps // 5):
        rig.step(desk)
        packet = rtp(next(sequence))
        assert shown(rig, desk, packet) == packet
        feedback = datagram_of(desk.end.media(rtcp(), rig.now_ns))
        assert rig.at_robot(feedback, desk.address).media == rtcp()
        rig.now_ns += 4 * STEP_NS
    assert rig.robot.renewals == desk.end.renewals >= 3
    assert len(rig.heard) - heard == len(desk.heard) - told == steps // 5
    assert (rig.sessions, desk.sessions, desk.calls) == (1, 1, 1)
    assert rig.robot.counts == desk.end.counts == {}


def test_new_keys_have_nothing_of_the_old_ones() -> None:
    rig, desk = connected()
    numbers = set()
    for _ in range(5):
        let_keys_age(rig, desk)
        rig.run_ms(2 * SECOND_MS, desk)
        assert rig.robot._peer is not None
        numbers.add(rig.robot._peer._session.number)
    assert len(numbers) == 5


@pytest.mark.verify
@settings(max_examples=30)
@given(st.integers(0, 2**32), st.floats(0, 0.5), st.floats(0, 0.5))
def test_keys_are_replaced_through_any_loss(seed: int, up_loss: float, down_loss: float) -> None:
    rig, desk = connected()
    draw = random.Random(seed)
    rig.up = lambda _: draw.random() >= up_loss
    rig.down = lambda _: draw.random() >= down_loss
    for _ in range(60):
        rig.run_ms(1000, desk)
        rig.now_ns += 4 * NS_PER_S
    rig.up = rig.down = everything
    rig.run_ms(5000, desk)
    assert rig.gets_through(desk)
    assert rig.robot.renewals == desk.end.renewals


def test_packets_that_the_old_keys_sealed_are_taken_for_a_while() -> None:
    rig, desk = connected()
    old = [datagram_of(rig.robot.media(rtp(number), rig.now_ns)) for number in (1, 2)]
    let_keys_age(rig, desk)
    rig.run_ms(1500, desk)
    assert rig.robot.renewals == 1
    assert shown(rig, desk, rtp(4)) == rtp(4)
    assert rig.at_desk(desk, old[0]).media == rtp(1)
    assert rig.at_desk(desk, old[0]).media is None  # once
    rig.now_ns += OVERLAP_NS
    assert rig.at_desk(desk, old[1]).media is None


def test_a_message_that_the_old_keys_sealed_is_late_once_the_new_ones_are_in_use() -> None:
    rig, desk = connected()
    held = [datagram_of(desk.end.message(b"held back", rig.now_ns)) for _ in range(3)]
    let_keys_age(rig, desk)
    rig.run_ms(1500, desk)
    for number, datagram in enumerate(held, 1):
        assert rig.at_robot(datagram, desk.address).message is None
        assert rig.robot.counts == {"late": number}


def test_a_recorded_request_for_new_keys_changes_nothing() -> None:
    rig, desk = connected()
    let_keys_age(rig, desk)
    rig.run_ms(1500, desk)
    requests = [one for one in desk.sent if len(one) == sealed_bytes(len(REKEY) + 48)]
    assert requests
    for datagram in requests * 3:
        assert rig.at_robot(datagram, THIEF).replies == []
    rig.run_ms(500, desk)
    assert rig.robot.renewals == 1
    assert rig.gets_through(desk)


def test_keys_that_could_not_be_replaced_are_not_used_after_ten_minutes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig, desk = connected()
    monkeypatch.setattr(RobotEnd, "_rekey", lambda *_: [])
    pass_s(rig, desk, OUTWORN_NS // NS_PER_S - 1)
    assert rig.gets_through(desk)
    assert rig.sessions == 1
    rig.run_ms(3000, desk)
    assert rig.sessions == 2  # begun anew
    assert rig.gets_through(desk)


@pytest.mark.parametrize("first", [65_000, 190_000])
def test_video_is_authentic_again_two_seconds_after_its_index_was_lost(first: int) -> None:
    """33,500 packets are lost in a row, and messages go on."""
    rig, desk = connected()
    desk.end.follow({7})
    sequence = first
    for _ in range(1500):
        sequence += 1
        assert shown(rig, desk, rtp(sequence)) == rtp(sequence)
    for _ in range(33_500):
        sequence += 1
        rig.robot.media(rtp(sequence), rig.now_ns)
    refused_ms = 0
    while shown(rig, desk, rtp(sequence := sequence + 1)) is None:
        rig.run_ms(10, desk)
        refused_ms += 10
    assert REFUSED_MS <= refused_ms <= REFUSED_MS + 100
    assert (rig.sessions, rig.robot.renewals) == (1, 1)


def test_a_stream_of_which_the_first_packets_are_lost_as_its_numbers_wrap_comes_back() -> None:
    rig, desk = connected()
    desk.end.follow({7, 8})
    for sequence in range(65_530, 65_536):  # all six are lost
        rig.robot.media(rtp(sequence), rig.now_ns)
    came = 0
    for sequence in range(65_536, 65_536 + 400):
        rig.run_ms(10, desk)
        other = rtp(sequence - 65_000, ssrc=8)
        assert shown(rig, desk, other) == other  # the other stream is well
        came += shown(rig, desk, rtp(sequence)) is not None
    assert came > 150
    assert rig.robot.renewals == 1


def test_refused_packets_of_streams_that_are_none_ask_for_no_keys() -> None:
    rig, desk = connected()
    desk.end.follow({7})
    draw = random.Random(1)
    for number in range(1000):
        rig.run_ms(10, desk)
        shown(rig, desk, rtp(number))
        rig.at_desk(desk, rtp(number, ssrc=9) + draw.randbytes(30))
        rig.at_desk(desk, rtp(number, ssrc=7) + draw.randbytes(30))
    assert rig.robot.renewals == 0


def test_refused_reports_ask_for_no_keys() -> None:
    """RTCP carries its index, which cannot be lost (RFC 3711, 3.4)."""
    rig, desk = connected()
    desk.end.follow({7})
    for _ in range(50):
        rig.now_ns += 9 * STEP_NS
        rig.step(desk)
        rig.at_desk(desk, rtcp(7) + bytes(20))
    assert (rig.robot.renewals, desk.end.counts["media not authentic"]) == (0, 50)


def test_who_makes_refused_packets_gets_no_more_than_new_keys_now_and_then() -> None:
    rig, desk = connected()
    desk.end.follow({7})
    for number in range(2000):  # of a stream that is silent
        rig.run_ms(10, desk)
        rig.at_desk(desk, rtp(number) + bytes(16))
    assert 5 <= rig.robot.renewals <= 10
    assert rig.gets_through(desk)
    assert (rig.sessions, desk.calls) == (1, 1)


def test_video_and_feedback_go_on_while_nothing_comes_under_the_new_keys_yet() -> None:
    """The operator's messages are lost as soon as both sides have agreed on new keys."""
    rig, desk = connected()
    let_keys_age(rig, desk)
    rig.up = lambda datagram: len(datagram) < sealed_bytes(0, HAND_BYTES)  # requests alone
    for sequence in range(1, 200):
        rig.step(desk)
        assert shown(rig, desk, rtp(sequence)) == rtp(sequence)
        feedback = datagram_of(desk.end.media(rtcp(), rig.now_ns))
        assert rig.at_robot(feedback, desk.address).media == rtcp()
        for packet in (rtp(sequence), rtcp()):  # a stranger's
            rig.at_desk(desk, packet + bytes(16))
            rig.at_robot(packet + bytes(16), THIEF)
    assert (rig.robot.renewals, desk.end.renewals) == (0, 0)
    rig.up = everything
    rig.run_ms(20, desk)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)
    assert rig.gets_through(desk)


def test_video_that_is_the_first_to_come_under_the_new_keys_is_shown() -> None:
    rig, desk = connected()
    let_keys_age(rig, desk)
    for sequence in range(1, 200):
        rig.now_ns += STEP_NS
        for request, _ in desk.end.step(rig.now_ns):
            rig.send_up(desk, request)
        rig.say(desk, b"hand")
        assert shown(rig, desk, rtp(sequence)) == rtp(sequence)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)


def test_new_keys_are_made_once_however_often_they_are_asked_for() -> None:
    """The round trip takes longer than the operator waits before they ask again."""
    rig, desk = connected()
    let_keys_age(rig, desk)
    rig.run_ms(900, desk)
    answers: list[tuple[bytes, Address]] = []
    while len(answers) < 3:
        rig.now_ns += STEP_NS
        for request, _ in desk.end.step(rig.now_ns):
            answers += rig.at_robot(request, desk.address).replies
    assert desk.calls == 1
    rig.at_desk(desk, answers[0][0])
    assert rig.robot.counts == desk.end.counts == {}
    rig.run_ms(50, desk)
    assert rig.gets_through(desk)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)


def test_what_is_no_request_for_new_keys_is_counted_and_not_answered() -> None:
    rig, desk = connected()
    for number, content in enumerate((b"", b"c" * 47, b"c" * 48, b"c" * 100), 1):
        addressed = datagram_of(desk.end.message(REKEY + content, rig.now_ns))
        heard = rig.at_robot(addressed, desk.address)
        assert (heard.message, heard.replies) == (None, [])
        assert rig.robot.counts == {"new keys that came to nothing": number}
    let_keys_age(rig, desk)
    rig.run_ms(2000, desk)
    assert rig.robot.renewals == 1


def test_what_is_no_answer_to_a_request_for_new_keys_is_counted_and_waited_past() -> None:
    rig, desk = connected()
    told = len(desk.heard)
    assert rig.tell(desk, REKEYED + b"c" * 48)  # they have not asked
    assert desk.end.counts == {}
    let_keys_age(rig, desk)
    rig.down = lambda datagram: len(datagram) >= sealed_bytes(0, STATE_BYTES)  # no answer comes
    rig.run_ms(2000, desk)
    rig.down = everything
    for number, content in enumerate((b"", b"c" * 47, b"c" * 48, b"c" * 100), 1):
        assert rig.tell(desk, REKEYED + content)
        assert desk.end.counts == {"new keys that came to nothing": number}
    assert set(desk.heard[told:]) == {b"state"}
    rig.run_ms(500, desk)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)
    assert rig.gets_through(desk)


@pytest.mark.parametrize("age_ns", [OUTWORN_NS - 1, OUTWORN_NS])
def test_what_arrives_when_its_keys_are_ten_minutes_old_counts_no_more(age_ns: int) -> None:
    rig, desk = Rig(), Desk()
    rig.step(desk)
    message = datagram_of(desk.end.message(b"held", rig.now_ns))
    media = datagram_of(desk.end.media(rtcp(), rig.now_ns))
    state = datagram_of(rig.robot.message(b"held", rig.now_ns))
    rig.now_ns += age_ns
    heard = (
        rig.at_robot(media, desk.address).media,
        rig.at_robot(message, desk.address).message,
        rig.at_desk(desk, state).message,
    )
    if age_ns < OUTWORN_NS:
        assert heard == (rtcp(), b"held", b"held")
        assert sent_to(rig) == desk.address
    else:
        assert heard == (None, None, None)
        assert sent_to(rig) is None
        assert desk.end.message(b"hand", rig.now_ns) is None
        assert (rig.robot.connected, desk.end.connected) == (False, False)
        assert rig.robot.counts == {"without a session": 2}
        assert desk.end.counts == {"without a session": 1}


# --- what can be told on the way ------------------------------------------------------------------


@settings(max_examples=20)
@given(st.binary(max_size=HAND_BYTES - 1), st.binary(max_size=STATE_BYTES - 1))
def test_the_length_of_what_is_sent_tells_nothing_of_what_is_said(
    hand: bytes, state: bytes
) -> None:
    rig, desk = connected()
    for said, size in ((b"h" + hand[1:], HAND_BYTES), (b"\0" + hand[:50], LINK_BYTES)):
        sent = datagram_of(desk.end.message(said, rig.now_ns))
        assert len(sent) == sealed_bytes(0, size)
    for said, size in ((b"s" + state[1:], STATE_BYTES), (b"\0" + state[:50], LINK_BYTES)):
        sent = datagram_of(rig.robot.message(said, rig.now_ns))
        assert len(sent) == sealed_bytes(0, size)


# --- consent --------------------------------------------------------------------------------------


@pytest.mark.parametrize("hours", [0.001, 1, 24])
def test_nothing_goes_to_an_operator_who_is_silent(hours: float) -> None:
    rig, desk = connected()
    rig.now_ns += LET_GO_NS - 1
    assert sent_to(rig) == desk.address
    assert rig.robot.media(rtp(1), rig.now_ns) is not None
    rig.now_ns += 1 + round((hours - 0.001) * 3600 * NS_PER_S)
    assert sent_to(rig) is None
    assert rig.robot.media(rtp(2), rig.now_ns) is None


def test_video_goes_on_when_a_silent_operator_is_heard_again() -> None:
    rig, desk = connected()
    rig.up = nothing
    rig.run_ms(LET_GO_MS + 500, desk)
    assert sent_to(rig) is None
    rig.up = everything
    rig.run_ms(20, desk)
    assert shown(rig, desk, rtp(1)) == rtp(1)


# --- who moves ------------------------------------------------------------------------------------


def test_an_operator_who_moves_to_another_address_is_followed() -> None:
    rig, desk = connected()
    before = len(rig.heard)
    desk.address = ELSEWHERE
    rig.run_ms(50, desk)
    assert len(rig.heard) - before == 5  # every message counts at once
    assert sent_to(rig) == ELSEWHERE
    assert rig.gets_through(desk)
    assert rig.sessions == 1


def test_one_datagram_that_was_caught_and_redirected_moves_nothing() -> None:
    rig, desk = connected()
    caught = datagram_of(desk.end.message(b"hand", rig.now_ns))
    heard = rig.at_robot(caught, THIEF)
    assert heard.message == b"hand"  # it is theirs, and new
    for _ in range(100):
        rig.now_ns += 20 * NS_PER_MS
        assert sent_to(rig) == desk.address
        media = rig.robot.media(rtp(1), rig.now_ns)
        assert media is None or media[1] == desk.address
    rig.now_ns += NS_PER_S
    assert sent_to(rig) is None


def test_a_victim_to_whose_address_every_message_is_redirected_gets_little() -> None:
    """Who sits on the way and gives all that the operator sends another source address."""
    rig, desk = connected()
    sent = received = 0
    for _ in range(1000):
        rig.now_ns += STEP_NS
        message = datagram_of(desk.end.message(b"h" * 180, rig.now_ns))
        sent += len(message)
        received += sum(len(reply) for reply, _ in rig.at_robot(message, THIEF).replies)
        assert sent_to(rig) == desk.address
    assert 0 < received < sent / 20


def test_however_many_addresses_messages_are_redirected_to_ten_questions_a_second_are_asked() -> (
    None
):
    rig, desk = connected()
    asked = 0
    for number in range(1000):
        rig.now_ns += STEP_NS
        message = datagram_of(desk.end.message(b"hand", rig.now_ns))
        asked += len(rig.at_robot(message, (f"10.0.1.{number % 250}", 1)).replies)
    assert asked == 100


def test_only_a_newer_message_asks_at_another_address() -> None:
    rig, desk = connected()
    end, now_ns = desk.end, rig.now_ns
    overtaken, newest = (datagram_of(end.message(text, now_ns)) for text in (b"older", b"newer"))
    media = datagram_of(end.media(rtp(1), now_ns))
    rig.at_robot(newest, desk.address)
    for datagram in (overtaken, newest, media, desk.sent[0], spoilt(newest, random.Random(0))):
        for reply, _ in rig.at_robot(datagram, THIEF).replies:
            assert len(reply) < 50  # a cookie, for the recorded initiation
        assert sent_to(rig) == desk.address
    assert rig.gets_through(desk)


def test_what_answers_a_question_from_elsewhere_moves_nothing() -> None:
    rig, desk = connected()
    caught = datagram_of(desk.end.message(b"hand", rig.now_ns))
    ((question, to),) = rig.at_robot(caught, THIEF).replies
    assert to == THIEF
    ((answer, _),) = desk.end.receive(question, THIEF, rig.now_ns).replies
    rig.at_robot(answer, ELSEWHERE)
    assert sent_to(rig) == desk.address
    assert len(question) == sealed_bytes(len(QUESTION) + 8) <= len(caught)


def test_an_operator_whose_answers_take_long_is_followed_too() -> None:
    """Asked again at the same address the question is the same; at another one it is another."""
    rig, desk = connected()
    questions: list[tuple[bytes, Address]] = []
    for number in range(60):
        rig.now_ns += STEP_NS
        hand = datagram_of(desk.end.message(b"hand", rig.now_ns))
        questions += rig.at_robot(hand, THIEF if number < 10 else ELSEWHERE).replies
    assert [to for _, to in questions] == [THIEF] + [ELSEWHERE] * 5
    answers = [desk.end.receive(one, ROBOT, rig.now_ns).replies[0][0] for one, _ in questions]
    rig.at_robot(answers[0], ELSEWHERE)  # to the question that was asked elsewhere
    assert sent_to(rig) == desk.address
    rig.at_robot(answers[1], ELSEWHERE)
    assert sent_to(rig) == ELSEWHERE


def test_an_operator_sends_to_the_address_that_was_dialled_wherever_answers_come_from() -> None:
    rig, desk = connected()
    state = datagram_of(rig.robot.message(b"state", rig.now_ns))
    assert desk.end.receive(state, THIEF, rig.now_ns).message == b"state"
    assert rig.gets_through(desk)


def test_a_request_for_new_keys_from_elsewhere_is_answered_by_a_question_alone() -> None:
    rig, desk = connected()
    let_keys_age(rig, desk)
    rig.run_ms(900, desk)
    replies: list[tuple[bytes, Address]] = []
    while not replies:
        rig.now_ns += STEP_NS
        for request, _ in desk.end.step(rig.now_ns):
            replies += rig.at_robot(request, ELSEWHERE).replies
    ((question, to),) = replies
    assert to == ELSEWHERE
    ((answer, _),) = desk.end.receive(question, ROBOT, rig.now_ns).replies
    rig.at_robot(answer, ELSEWHERE)
    assert sent_to(rig) == ELSEWHERE
    desk.address = ELSEWHERE
    rig.run_ms(500, desk)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)


def test_an_operator_who_moves_while_keys_are_replaced_stays() -> None:
    rig, desk = connected()
    let_keys_age(rig, desk)
    rig.run_ms(900, desk)
    for number in range(60):
        desk.address = (f"10.0.1.{number}", 1)
        rig.run_ms(50, desk)
    rig.run_ms(ATTEMPT_NS / NS_PER_MS, desk)
    assert rig.gets_through(desk)
    assert (rig.sessions, rig.robot.renewals) == (1, 1)

"""What a session does with messages and media: lengths, order, new keys, silence, and moves."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.addresses import Address
from tams_app.link.caller import Caller
from tams_app.link.channel import (
    HAND_BYTES,
    LET_GO_NS,
    LINK_BYTES,
    LONGEST_MESSAGE_BYTES,
    OUTWORN_NS,
    OVERLAP_NS,
    PING,
    QUESTION,
    RENEW_NS,
    STATE_BYTES,
    is_rtcp,
    message_bytes,
    ssrc_of,
)
from tams_app.link.door import Door
from tams_app.link.quic import (
    ACK_WAIT_NS,
    LONGEST_CONTENT_BYTES,
    LONGEST_DATAGRAM_BYTES,
    OVERHEAD_BYTES,
    SESSION_BYTES,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.link.rig import (
    DESK,
    LET_GO_MS,
    ROBOT,
    STEP_NS,
    THIEF,
    Desk,
    Rig,
    channel_of,
    connected,
    datagram_of,
    everything,
    flipped,
    link_message,
    nothing,
    rtcp,
    rtp,
    spoilt,
)

pytestmark = pytest.mark.untimed

ELSEWHERE: Address = ("10.0.1.77", 50_000)


def sent_to(rig: Rig) -> Address | None:
    """Where the robot's next state goes; None: nowhere."""
    sent = rig.robot.message(b"state", rig.now_ns)
    return sent[0][1] if sent else None


def settled(rig: Rig, desk: Desk) -> None:
    """All that is due is sent, so that what follows is alone in its datagram."""
    rig.run_ms(50, desk)
    for end in (desk.end, rig.robot):
        end.message(b"after what was due", rig.now_ns)


# --- messages and media ---------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=HAND_BYTES), st.binary(max_size=STATE_BYTES))
def test_the_length_of_what_is_sent_tells_nothing_of_what_is_said(
    hand: bytes, state: bytes
) -> None:
    rig, desk = connected()
    settled(rig, desk)
    for end, said, size in ((desk.end, hand, HAND_BYTES), (rig.robot, state, STATE_BYTES)):
        assert len(datagram_of(end.message(said, rig.now_ns))) == message_bytes(0, size)
        link = link_message(end, PING + said[:50], rig.now_ns)
        assert len(link) == message_bytes(0, LINK_BYTES)


def test_a_message_fills_its_size_whole_before_it_takes_the_next() -> None:
    sizes = (LINK_BYTES, HAND_BYTES, STATE_BYTES, LONGEST_MESSAGE_BYTES)
    assert message_bytes(LONGEST_MESSAGE_BYTES) == LONGEST_DATAGRAM_BYTES - SESSION_BYTES
    for size, larger in pairwise(sizes):
        assert (
            message_bytes(0) + size - LINK_BYTES == message_bytes(size) == message_bytes(size - 1)
        )
        assert message_bytes(size + 1) == message_bytes(0, size + 1) == message_bytes(larger)


@pytest.mark.parametrize("length", [0, 1, 255, 256, 257, 512, 513, LONGEST_MESSAGE_BYTES])
@pytest.mark.parametrize("end", [b"", b"\0\0", b"\x80"])
def test_a_message_arrives_as_it_was(length: int, end: bytes) -> None:
    rig, desk = connected()
    message = (b"m" * length + end)[-length:] if length else b""
    rig.say(desk, message)
    rig.tell(message)
    assert rig.heard[-1] == desk.heard[-1] == message


def test_a_message_that_is_too_long_is_counted_and_holds_nothing_up() -> None:
    rig, desk = connected()
    rig.say(desk, bytes(LONGEST_MESSAGE_BYTES + 1))
    rig.tell(bytes(5000))
    assert desk.end.counts["too long to be sent"] == rig.robot.counts["too long to be sent"] == 1
    assert rig.gets_through(desk)


@pytest.mark.parametrize("packet", [rtp(1), rtp(9, size=12), rtp(2, size=1163), rtcp()])
def test_packets_come_back_as_they_were(packet: bytes) -> None:
    rig, desk = connected()
    settled(rig, desk)
    (sent,) = rig.robot.media(packet, rig.now_ns)
    assert len(packet) + OVERHEAD_BYTES - 1 <= len(sent[0]) <= LONGEST_DATAGRAM_BYTES
    rig.send_down([sent])
    rig.send_up(desk, desk.end.media(packet, rig.now_ns))
    assert rig.media == desk.media == [packet]


@pytest.mark.parametrize(
    "packet", [b"", b"\x80", rtp(1, size=LONGEST_CONTENT_BYTES + 1), bytes(40), b"\xc0" * 40]
)
def test_what_is_no_packet_of_media_or_too_long_is_counted_and_holds_nothing_up(
    packet: bytes,
) -> None:
    rig, desk = connected()
    settled(rig, desk)
    for end in (rig.robot, desk.end):
        assert end.media(packet, rig.now_ns) == []
        assert end.counts["no packet that can be sent"] == 1
    rig.send_down(rig.robot.media(rtp(2), rig.now_ns))
    assert desk.media == [rtp(2)]


def test_a_packet_of_full_length_is_sent_at_once_although_an_acknowledgement_is_due() -> None:
    rig, desk = connected()
    rig.say(desk, b"hand")
    rig.now_ns += STEP_NS
    longest = rtp(1, size=LONGEST_CONTENT_BYTES)
    sent = rig.robot.media(longest, rig.now_ns)
    assert len(sent) == 2
    rig.send_down(sent)
    assert desk.media == [longest]


@pytest.mark.parametrize("packets", [1, 3000])
def test_nothing_waits_however_much_was_sent_and_not_acknowledged(packets: int) -> None:
    rig, desk = connected()
    rig.up = nothing
    for number in range(packets):
        sent = rig.robot.media(rtp(number, size=1163), rig.now_ns)
        assert len(sent) in (1, 2)
        rig.send_down(sent)
    assert desk.media[-1] == rtp(packets - 1, size=1163)
    assert not channel_of(rig.robot).connection._quic._datagrams_pending


@pytest.mark.parametrize("order", [[1, 0, 2], [2, 0, 1], [0, 0, 1], [2, 1, 0]])
def test_the_newest_message_counts_and_each_once(order: list[int]) -> None:
    rig, desk = connected()
    sent = [datagram_of(desk.end.message(bytes((n,)), rig.now_ns)) for n in range(3)]
    rig.heard.clear()
    for number in order:
        rig.at_robot(sent[number], desk.address)
    newest = [n for at, n in enumerate(order) if n > max(order[:at], default=-1)]
    assert [message[0] for message in rig.heard] == newest
    assert rig.robot.counts["late"] == 3 - len(newest)


def test_packets_of_media_that_were_overtaken_are_taken_once() -> None:
    rig, desk = connected()
    sent = [datagram_of(rig.robot.media(rtp(n), rig.now_ns)) for n in range(1, 101)]
    random.Random(5).shuffle(sent)
    for datagram in sent + sent:
        rig.at_desk(desk, datagram)
    assert sorted(desk.media) == [rtp(n) for n in range(1, 101)]
    assert desk.end.counts["late"] == 100


@pytest.mark.parametrize("media", [True, False])
def test_what_was_changed_on_the_way_is_counted_and_changes_nothing(media: bool) -> None:
    rig, desk = connected()
    end, now_ns = desk.end, rig.now_ns
    sent = datagram_of(end.media(rtp(1), now_ns) if media else end.message(b"x", now_ns))
    rig.heard.clear()
    for changed in (
        *flipped(sent),
        *(sent[:length] for length in range(1, len(sent))),
        sent + b"x",
    ):
        rig.at_robot(changed, desk.address)
    assert (rig.heard, rig.media) == ([], [])
    counted = rig.robot.counts
    assert (
        counted["not authentic"] + counted["without a session"] + counted["of no known kind"] > 500
    )
    rig.at_robot(sent, desk.address)
    assert (rig.media if media else rig.heard) == [rtp(1) if media else b"x"]


def test_a_datagram_of_the_other_direction_or_of_another_session_is_refused() -> None:
    rig, desk = connected()
    other_rig, other = connected()
    for datagram in (
        datagram_of(rig.robot.message(b"state", rig.now_ns)),
        datagram_of(other.end.message(b"hand", other_rig.now_ns)),
    ):
        assert rig.at_robot(datagram, desk.address).messages == []
    assert rig.robot.counts["without a session"] == 2


@pytest.mark.parametrize(
    "content", [b"\x03" + bytes(80), b"\x01\0\0\0\1\0\x09x", b"", b"\x01", bytes(40), b"\x80x"]
)
def test_what_is_authentic_and_no_message_is_counted(content: bytes) -> None:
    rig, desk = connected()
    channel_of(desk.end).connection.put(content)
    before = len(rig.heard), rig.robot.counts["of no known kind"]
    rig.send_up(desk, channel_of(desk.end).datagrams(rig.now_ns))
    assert (len(rig.heard), rig.robot.counts["of no known kind"]) == (before[0], before[1] + 1)


def test_several_messages_in_one_packet_are_all_heard() -> None:
    """Ours sends each alone; another version may not."""
    rig, desk = connected()
    channel = channel_of(desk.end)
    for message in (b"a", b"b"):
        channel.message(message)
    channel.media(rtp(3))
    rig.send_up(desk, channel.datagrams(rig.now_ns))
    assert rig.heard[-2:] == [b"a", b"b"]
    assert rig.media == [rtp(3)]


def test_a_ping_comes_back_and_a_message_of_the_link_that_nobody_knows_is_counted() -> None:
    rig, desk = connected()
    ((pong, _),) = rig.at_robot(link_message(desk.end, PING + b"7", rig.now_ns), DESK).replies
    assert desk.end.receive(pong, ROBOT, rig.now_ns).echoes == [b"7"]
    for end, at in ((desk.end, rig.robot), (rig.robot, desk.end)):
        at.receive(link_message(end, b"what?", rig.now_ns), DESK, rig.now_ns)
        assert at.counts["of no known kind"] == 1


def test_rtcp_is_told_by_its_packet_type() -> None:
    assert [is_rtcp(bytes((0x80, kind))) for kind in (191, 192, 223, 224)] == [
        False,
        True,
        True,
        False,
    ]
    assert not is_rtcp(b"")
    assert not is_rtcp(b"\x80")


@pytest.mark.parametrize("ssrc", [0, 7, 0xFFFF_FFFF])
def test_a_packet_tells_its_stream(ssrc: int) -> None:
    assert ssrc_of(rtp(1, ssrc)) == ssrc_of(rtcp(ssrc)) == ssrc
    assert ssrc_of(b"") == 0


# --- acknowledgements -----------------------------------------------------------------------------


def test_acknowledgements_travel_with_what_is_sent_anyway() -> None:
    rig, desk = connected()
    rig.run_ms(500, desk)
    before = len(desk.sent), len(desk.came)
    rig.run_ms(1000, desk)
    assert len(desk.sent) - before[0] == len(desk.came) - before[1] == 100


@pytest.mark.parametrize("of_robot", [True, False])
def test_what_is_heard_is_acknowledged_in_time_although_nothing_is_said(of_robot: bool) -> None:
    rig, desk = connected()
    rig.now_ns += ACK_WAIT_NS + NS_PER_MS
    rig.send_up(desk, desk.end.step(rig.now_ns))
    rig.send_down(rig.robot.step(rig.now_ns))
    end: Door | Caller = rig.robot if of_robot else desk.end
    if of_robot:
        rig.say(desk, b"hand")
    else:
        rig.tell(b"state")
    due_ns = end.due_ns(rig.now_ns)
    assert due_ns is not None
    assert 0 < due_ns - rig.now_ns <= ACK_WAIT_NS + 2 * NS_PER_MS
    assert end.step(due_ns - 1) == []
    (acknowledgement,) = end.step(due_ns)
    assert len(acknowledgement[0]) < 60


# --- new keys -------------------------------------------------------------------------------------


def ten_minutes(rig: Rig, desk: Desk, step_ns: int = 100 * NS_PER_MS) -> None:
    """Let them pass in larger steps."""
    for _ in range(600 * NS_PER_S // step_ns):
        rig.now_ns += step_ns - STEP_NS
        rig.step(desk)


def test_the_keys_of_a_session_are_replaced_every_five_minutes_and_nothing_is_lost() -> None:
    rig, desk = connected()
    heard, came = len(rig.heard), len(desk.heard)
    ten_minutes(rig, desk)
    assert len(rig.heard) - heard == len(desk.heard) - came == 6000
    assert (rig.robot.renewals, desk.end.renewals) == (2, 2)
    assert (rig.sessions, desk.sessions) == (1, 1)
    assert rig.robot.counts["not authentic"] == desk.end.counts["not authentic"] == 0


def test_what_the_old_keys_sealed_is_taken_while_new_ones_are_agreed_on() -> None:
    rig, desk = connected()
    up = datagram_of(desk.end.media(rtp(1), rig.now_ns))
    channel_of(desk.end).connection.renew_keys()
    first = datagram_of(desk.end.message(b"new", rig.now_ns))
    down = [datagram_of(rig.robot.media(rtp(n), rig.now_ns)) for n in (2, 3)]
    rig.at_desk(desk, down[0])  # the robot's side does not know of them yet
    rig.at_robot(first, desk.address)
    rig.at_robot(up, desk.address)  # overtaken by the first one
    new = datagram_of(rig.robot.media(rtp(4), rig.now_ns))
    rig.at_desk(desk, new)
    rig.at_desk(desk, down[1])
    assert (rig.media, desk.media) == ([rtp(1)], [rtp(2), rtp(4), rtp(3)])
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)
    assert rig.heard[-1] == b"new"


def test_what_the_old_keys_sealed_is_taken_for_a_moment_only() -> None:
    rig, desk = connected()
    late = datagram_of(desk.end.media(rtp(1), rig.now_ns))
    channel_of(desk.end).connection.renew_keys()
    rig.run_ms(50, desk)
    assert (rig.robot.renewals, desk.end.renewals) == (1, 1)
    before = rig.robot.counts["not authentic"]
    for _ in range(60):
        rig.now_ns += OVERLAP_NS // 50
        rig.say(desk, b"hand")
        rig.tell(b"state")
    rig.at_robot(late, desk.address)
    assert rig.media == []
    assert rig.robot.counts["not authentic"] == before + 1


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32), st.floats(0, 0.7), st.floats(0, 0.7))
def test_keys_are_replaced_through_any_loss(seed: int, up_loss: float, down_loss: float) -> None:
    rig, desk = connected()
    draw = random.Random(seed)
    for _ in range(RENEW_NS // NS_PER_S):
        rig.now_ns += NS_PER_S - STEP_NS
        rig.step(desk)
    rig.up = lambda _: draw.random() >= up_loss
    rig.down = lambda _: draw.random() >= down_loss
    rig.run_ms(1500, desk)
    rig.up = rig.down = everything
    rig.run_ms(500, desk)
    assert rig.gets_through(desk)
    assert rig.sessions == 1
    assert rig.robot.renewals == desk.end.renewals >= 1


def test_who_makes_packets_that_look_like_new_keys_changes_none() -> None:
    rig, desk = connected()
    real = datagram_of(desk.end.message(b"hand", rig.now_ns))
    draw = random.Random(2)
    for _ in range(300):
        forged = real[:9] + draw.randbytes(len(real) - 9)
        rig.at_robot(forged, desk.address)
    assert rig.robot.renewals == 0
    assert rig.gets_through(desk)


@pytest.mark.parametrize("age_ns", [OUTWORN_NS, 24 * 3600 * NS_PER_S])
def test_keys_that_were_not_replaced_for_ten_minutes_are_used_no_more(age_ns: int) -> None:
    rig, desk = connected()
    recorded = datagram_of(desk.end.message(b"hand", rig.now_ns))
    rig.now_ns += age_ns
    assert rig.at_robot(recorded, desk.address).messages == []
    assert desk.end.message(b"hand", rig.now_ns) == []
    assert (rig.robot.connected, desk.end.connected) == (False, False)


# --- consent --------------------------------------------------------------------------------------


@pytest.mark.parametrize("hours", [0.001, 0.1, 1, 24])
def test_nothing_goes_to_an_operator_who_is_silent(hours: float) -> None:
    rig, desk = connected()
    rig.now_ns += LET_GO_NS - 1
    assert sent_to(rig) == desk.address
    assert rig.robot.media(rtp(1), rig.now_ns)
    rig.now_ns += 1
    end_ns = rig.now_ns + round(min(hours, 0.01) * 3600 * NS_PER_S)
    while rig.now_ns < end_ns:
        rig.now_ns += STEP_NS
        assert rig.robot.step(rig.now_ns) == []  # no probe, no acknowledgement
        assert rig.robot.due_ns(rig.now_ns) is None
    rig.now_ns += round(hours * 3600 * NS_PER_S)
    assert sent_to(rig) is None
    assert rig.robot.media(rtp(2), rig.now_ns) == rig.robot.step(rig.now_ns) == []


def test_video_goes_on_when_a_silent_operator_is_heard_again() -> None:
    rig, desk = connected()
    rig.up = nothing
    rig.run_ms(LET_GO_MS + 500, desk)
    assert sent_to(rig) is None
    rig.up = everything
    rig.run_ms(20, desk)
    rig.send_down(rig.robot.media(rtp(1), rig.now_ns))
    assert desk.media == [rtp(1)]


@pytest.mark.parametrize("asleep_s", [10, 3600, 30 * 86_400])
def test_an_operators_computer_that_was_suspended_comes_back(asleep_s: int) -> None:
    """Its clock has stood still: it does not know, and the robot's side has let go."""
    rig, desk = connected()
    recorded = len(rig.heard)
    rig.now_ns += asleep_s * NS_PER_S
    assert sent_to(rig) is None
    behind_ns = asleep_s * NS_PER_S
    for _ in range(600):
        rig.now_ns += STEP_NS
        for datagram, _ in desk.end.step(rig.now_ns - behind_ns) + desk.end.message(
            b"hand", rig.now_ns - behind_ns
        ):
            for reply, _ in rig.at_robot(datagram, desk.address).replies:
                waiting = desk.end.receive(reply, ROBOT, rig.now_ns - behind_ns).replies
                while waiting:
                    up, waiting = waiting, []
                    for one, _ in up:
                        for back, _ in rig.at_robot(one, desk.address).replies:
                            now_ns = rig.now_ns - behind_ns
                            waiting += desk.end.receive(back, ROBOT, now_ns).replies
    assert len(rig.heard) > recorded + 100
    assert rig.robot.connected
    assert desk.end.connected


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
    assert heard.messages == [b"hand"]  # it is theirs, and new
    for _ in range(100):
        rig.now_ns += 20 * NS_PER_MS
        assert sent_to(rig) == desk.address
        sent = rig.robot.media(rtp(1), rig.now_ns) + rig.robot.step(rig.now_ns)
        assert {to for _, to in sent} <= {desk.address}
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
        replies = rig.at_robot(message, THIEF).replies
        received += sum(len(reply) for reply, to in replies if to == THIEF)
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
        replies = rig.at_robot(message, (f"10.0.1.{number % 250}", 1)).replies
        asked += sum(to != desk.address for _, to in replies)
    assert asked == 100


def test_only_a_newer_message_asks_at_another_address() -> None:
    rig, desk = connected()
    end, now_ns = desk.end, rig.now_ns
    overtaken, newest = (datagram_of(end.message(text, now_ns)) for text in (b"older", b"newer"))
    media = datagram_of(end.media(rtp(1), now_ns))
    rig.at_robot(newest, desk.address)
    for datagram in (overtaken, newest, media, spoilt(newest, random.Random(0))):
        assert rig.at_robot(datagram, THIEF).replies == []
        assert sent_to(rig) == desk.address
    assert rig.gets_through(desk)


def test_what_answers_a_question_from_elsewhere_moves_nothing() -> None:
    rig, desk = connected()
    settled(rig, desk)
    caught = datagram_of(desk.end.message(b"hand", rig.now_ns))
    ((question, to),) = rig.at_robot(caught, THIEF).replies
    assert to == THIEF
    (answer, _) = desk.end.receive(question, THIEF, rig.now_ns).replies[-1]
    rig.at_robot(answer, ELSEWHERE)
    assert sent_to(rig) == desk.address
    assert len(question) == message_bytes(len(QUESTION) + 8) <= len(caught)


def test_an_operator_whose_answers_take_long_is_followed_too() -> None:
    """Asked again at the same address the question is the same; at another one it is another."""
    rig, desk = connected()
    questions: list[tuple[bytes, Address]] = []
    for number in range(60):
        rig.now_ns += STEP_NS
        hand = datagram_of(desk.end.message(b"hand", rig.now_ns))
        replies = rig.at_robot(hand, THIEF if number < 10 else ELSEWHERE).replies
        questions += [one for one in replies if one[1] != desk.address]
    assert [to for _, to in questions] == [THIEF] + [ELSEWHERE] * 5
    answers = [desk.end.receive(one, ROBOT, rig.now_ns).replies[-1][0] for one, _ in questions]
    rig.at_robot(answers[0], ELSEWHERE)  # to the question that was asked elsewhere
    assert sent_to(rig) == desk.address
    rig.at_robot(answers[1], ELSEWHERE)
    assert sent_to(rig) == ELSEWHERE


def test_an_operator_sends_to_the_address_that_was_dialled_wherever_answers_come_from() -> None:
    rig, desk = connected()
    state = datagram_of(rig.robot.message(b"state", rig.now_ns))
    assert desk.end.receive(state, THIEF, rig.now_ns).messages == [b"state"]
    assert rig.gets_through(desk)


def test_an_operator_who_moves_while_keys_are_replaced_stays() -> None:
    rig, desk = connected()
    channel_of(desk.end).connection.renew_keys()
    for number in range(60):
        desk.address = (f"10.0.1.{number}", 1)
        rig.run_ms(50, desk)
    rig.run_ms(500, desk)
    assert rig.gets_through(desk)
    assert (rig.sessions, rig.robot.renewals) == (1, 1)

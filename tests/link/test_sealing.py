"""What is sealed opens once, in order, at the other side of the same session, or not at all."""

from __future__ import annotations

import random
import secrets
import struct
from itertools import pairwise

import pytest
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.handshake import SessionKeys, session_keys
from tams_app.link.noise import Initiator, Responder
from tams_app.link.sealing import (
    HAND_BYTES,
    LINK_BYTES,
    LONGEST_DATAGRAM_BYTES,
    LONGEST_MESSAGE_BYTES,
    LONGEST_PLAIN_BYTES,
    MEDIA_OVERHEAD_BYTES,
    STATE_BYTES,
    Media,
    MessageOpener,
    MessageSealer,
    is_rtcp,
    sealed_bytes,
    ssrc_of,
)
from tests.link.rig import flipped, rtcp, rtp

pytestmark = pytest.mark.untimed

SECRET = b"k" * 32
KIND = 0xC3


def session() -> tuple[SessionKeys, SessionKeys]:
    """The keys of both sides of a new session."""
    initiator = Initiator(SECRET, b"", secrets.token_bytes(32), b"")
    message, theirs = Responder(SECRET, b"", initiator.message).answer(secrets.token_bytes(32), b"")
    ours = initiator.finish(message)[1]
    return session_keys(ours, initiator=True), session_keys(theirs, initiator=False)


def sealer_of(keys: SessionKeys) -> MessageSealer:
    return MessageSealer(keys.send.messages, KIND, keys.number)


def messages() -> tuple[MessageSealer, MessageOpener]:
    ours, theirs = session()
    return sealer_of(ours), MessageOpener(theirs.receive.messages)


def media() -> tuple[Media, Media]:
    ours, theirs = session()
    return Media(ours), Media(theirs)


def protected_by(out: Media, packet: bytes) -> bytes:
    protected = out.protect(packet)
    assert protected is not None
    return protected


def by_hand(key: bytes, session: bytes, number: int, whole: bytes) -> bytes:
    """The datagram whose encrypted part is `whole`, as the module's documentation has it."""
    head = bytes((KIND,)) + session + number.to_bytes(8)
    return head + ChaCha20Poly1305(key).encrypt(bytes(4) + number.to_bytes(8), whole, head)


# --- messages -------------------------------------------------------------------------------------


@given(st.binary(max_size=1500), st.sampled_from([b"", b"\0", b"\x80"]))
def test_a_message_that_ends_in_any_bytes_opens_as_it_was_and_fits_one_of_four_sizes(
    content: bytes, end: bytes
) -> None:
    sealer, opener = messages()
    for message in (content + end, (content + end)[-LONGEST_MESSAGE_BYTES:]):
        datagram = sealer.seal(message)
        assert datagram[0] == KIND
        assert len(datagram) == sealed_bytes(len(message))
        assert opener.open(datagram) == message
    assert len(datagram) in {93, 285, 541, LONGEST_DATAGRAM_BYTES}
    assert opener.late == 0


def test_a_message_fills_its_size_whole_before_it_takes_the_next() -> None:
    """One byte of each size marks where the message ends."""
    sizes = (LINK_BYTES, HAND_BYTES, STATE_BYTES, LONGEST_MESSAGE_BYTES + 1)
    overhead = LONGEST_DATAGRAM_BYTES - sizes[-1]
    for size in sizes:
        assert sealed_bytes(size - 1) == overhead + size
        assert sealed_bytes(size - 2) == overhead + size
    for size, larger in pairwise(sizes):
        assert sealed_bytes(size) == sealed_bytes(0, size + 1) == overhead + larger
    assert sealed_bytes(LONGEST_MESSAGE_BYTES + 1) == LONGEST_DATAGRAM_BYTES + 1
    sealer, opener = messages()
    for least in sizes:
        datagram = sealer.seal(b"short", least)
        assert len(datagram) == overhead + least
        assert opener.open(datagram) == b"short"


def test_a_datagram_is_what_the_protocol_says() -> None:
    """Kind, session and number in the clear; the number is the nonce, and counts from one."""
    sealer = MessageSealer(SECRET, KIND, b"sess")
    for number in range(1, 300):
        whole = b"move\x80".ljust(LINK_BYTES, b"\0")
        assert sealer.seal(b"move") == by_hand(SECRET, b"sess", number, whole)


def test_what_is_authentic_and_holds_no_message_is_none() -> None:
    opener = MessageOpener(SECRET)
    assert opener.open(by_hand(SECRET, b"sess", 1, b"")) is None
    assert opener.open(by_hand(SECRET, b"sess", 1, b"move\x80")) == b"move"


@given(st.lists(st.integers(0, 19), max_size=60))
def test_a_message_opens_if_it_is_newer_than_all_before(order: list[int]) -> None:
    """Whether others were lost, repeated or overtaken."""
    sealer, opener = messages()
    sent = [sealer.seal(bytes((number,))) for number in range(20)]
    newest, late = -1, 0
    for number in order:
        is_new, newest = number > newest, max(newest, number)
        late += not is_new
        assert opener.open(sent[number]) == (bytes((number,)) if is_new else None)
        assert opener.late == late


def test_a_message_of_which_a_bit_or_the_length_is_another_is_refused_and_changes_nothing() -> None:
    sealer, opener = messages()
    datagram = sealer.seal(b"move")
    assert [opener.open(spoilt) for spoilt in flipped(datagram)] == [None] * (8 * len(datagram))
    assert opener.late == 0
    for length in range(len(datagram)):
        assert opener.open(datagram[:length]) is None
    assert opener.open(datagram + b"\0") is None
    assert opener.open(datagram) == b"move"


def test_a_message_of_the_other_direction_is_refused() -> None:
    ours, theirs = session()
    back = sealer_of(theirs).seal(b"reflected")
    assert MessageOpener(theirs.receive.messages).open(back) is None
    assert MessageOpener(ours.receive.messages).open(back) == b"reflected"


def test_a_message_of_another_session_is_refused() -> None:
    (sealer, _), (_, opener) = messages(), messages()
    assert opener.open(sealer.seal(b"recorded")) is None


# --- video and its feedback -----------------------------------------------------------------------

SHORTEST = struct.pack("!BBHI", 0x80, 201, 1, 7)  # a receiver report that reports of nothing


@pytest.mark.parametrize("packet", [rtp(), rtcp(), rtp(size=12), rtp(size=268), SHORTEST], ids=len)
def test_packets_come_back_as_they_were(packet: bytes) -> None:
    out, back = media()
    protected = protected_by(out, packet)
    assert len(packet) + MEDIA_OVERHEAD_BYTES <= len(protected) <= len(packet) + 20
    assert packet[12:] == b"" or packet[12:] not in protected
    assert back.unprotect(protected) == packet


def test_a_packets_number_is_used_once() -> None:
    """Two packets under one number of one key would give away what both hold (RFC 7714, 8.3)."""
    out, _ = media()
    assert out.protect(rtp(1)) is not None
    assert out.protect(rtp(1)) is None
    assert out.protect(rtp(1, size=80)) is None
    assert out.protect(rtp(2)) is not None


def test_streams_go_on_over_the_wrap_of_their_sequence_numbers() -> None:
    out, back = media()
    for number in range(65_500, 65_600):
        for ssrc in (7, 8):
            packet = rtp(number, ssrc=ssrc)
            protected = protected_by(out, packet)
            assert back.unprotect(protected) == packet


def test_packets_that_were_overtaken_are_taken_once() -> None:
    out, back = media()
    packets = [rtp(number) for number in range(1, 200)]
    sent = [out.protect(packet) for packet in packets]
    order = list(range(len(packets)))
    random.Random(0).shuffle(order)
    for index in order:
        protected = sent[index]
        assert protected is not None
        assert back.unprotect(protected) == packets[index]
        assert back.unprotect(protected) is None


@pytest.mark.parametrize("packet", [rtp(), rtcp()], ids=["rtp", "rtcp"])
def test_a_packet_of_which_a_bit_or_the_length_is_another_is_refused_and_changes_nothing(
    packet: bytes,
) -> None:
    out, back = media()
    protected = protected_by(out, packet)
    assert set(map(back.unprotect, flipped(protected))) == {None}
    for length in range(len(protected)):
        assert back.unprotect(protected[:length]) is None
    assert back.unprotect(protected + b"\0") is None
    assert back.unprotect(protected) == packet


@pytest.mark.parametrize("packet", [rtp(), rtcp()], ids=["rtp", "rtcp"])
def test_a_packet_of_the_other_direction_or_session_is_refused(packet: bytes) -> None:
    out, _ = media()
    protected = protected_by(out, packet)
    assert out.unprotect(protected) is None
    assert media()[1].unprotect(protected) is None


def test_a_packet_that_is_too_long_to_be_protected_is_left_out() -> None:
    out, back = media()
    longest = rtp(size=12) + bytes(LONGEST_PLAIN_BYTES - 12)
    protected = protected_by(out, longest)
    assert back.unprotect(protected) == longest
    for number, length in enumerate(range(LONGEST_PLAIN_BYTES + 1, 1600), 2):
        assert out.protect(rtp(number, size=12) + bytes(length - 12)) is None


def test_nonsense_of_any_length_changes_nothing() -> None:
    out, back = media()
    sealer, opener = messages()
    draw = random.Random(1)
    for length in range(1601):
        nonsense = draw.randbytes(length)
        for first in (b"", b"\x80\x60", b"\x81\xc9", b"\x9f\x60", b"\xbf\xe0"):
            packet = (first + nonsense)[:length]
            assert back.unprotect(packet) is None
            assert opener.open(packet) is None
        assert opener.open((bytes((KIND,)) + nonsense)[:length]) is None
    protected = protected_by(out, rtp())
    assert back.unprotect(protected) == rtp()
    assert opener.open(sealer.seal(b"move")) == b"move"
    assert opener.late == 0


def test_what_is_neither_rtp_nor_rtcp_is_not_protected() -> None:
    out, _ = media()
    draw = random.Random(2)
    for length in range(1601):
        first = bytes((draw.randrange(128),))  # version 0 or 1
        assert out.protect((first + draw.randbytes(length))[:length]) is None


def test_rtcp_is_told_by_its_packet_type() -> None:
    rtcp_types = [second for second in range(256) if is_rtcp(bytes((0x80, second)))]
    assert rtcp_types == [*range(192, 224)]
    assert not is_rtcp(b"\x80")
    assert not is_rtcp(b"")


@given(st.integers(0, 2**32 - 1))
def test_a_packet_tells_its_stream(ssrc: int) -> None:
    for packet in (rtp(ssrc=ssrc), rtp(ssrc=ssrc, size=12), rtcp(ssrc), rtcp(ssrc)[:8]):
        assert ssrc_of(packet) == ssrc
    assert ssrc_of(rtp(ssrc=ssrc)[:8]) == ssrc_of(rtcp(ssrc)[:4]) == ssrc_of(b"") == 0

"""The handshake: nothing comes of it without the key, and every session has keys of its own."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link import handshake
from tams_app.link.handshake import (
    MEDIA_KEY_BYTES,
    MESSAGE_KEY_BYTES,
    Answerer,
    Dialer,
    HandshakeError,
    SessionKeys,
)

pytestmark = pytest.mark.untimed

KEY, OTHER_KEY = b"k" * 32, b"k" * 31 + b"l"


def shake(key: bytes = KEY) -> tuple[SessionKeys, SessionKeys]:
    """The keys of both sides."""
    dialer = Dialer(key, b"hello")
    answer, theirs = Answerer(key, dialer.hello).answer(b"welcome")
    return dialer.finish(answer)[1], theirs


def all_keys(keys: SessionKeys) -> list[bytes]:
    return [
        keys.send.messages,
        keys.send.media,
        keys.receive.messages,
        keys.receive.media,
    ]


def flipped(datagram: bytes) -> list[bytes]:
    """Every copy of it with one bit changed."""
    whole = int.from_bytes(datagram, "big")
    return [(whole ^ 1 << bit).to_bytes(len(datagram), "big") for bit in range(8 * len(datagram))]


@given(st.binary(max_size=1000), st.binary(max_size=1000))
def test_each_side_hears_what_the_other_says(greeting: bytes, content: bytes) -> None:
    dialer = Dialer(KEY, greeting)
    answerer = Answerer(KEY, dialer.hello)
    answer, _ = answerer.answer(content)
    assert answerer.greeting == greeting
    assert dialer.finish(answer)[0] == content


def test_what_one_side_sends_with_the_other_receives_with() -> None:
    ours, theirs = shake()
    assert ours.send == theirs.receive
    assert ours.receive == theirs.send


def test_directions_and_purposes_have_keys_of_their_own() -> None:
    ours, _ = shake()
    parts = [part for key in all_keys(ours) for part in (key[:32], key[32:]) if part]
    assert len(set(parts)) == len(parts) == 6
    assert [len(key) for key in all_keys(ours)] == 2 * [MESSAGE_KEY_BYTES, MEDIA_KEY_BYTES]


def test_every_session_has_fresh_keys() -> None:
    keys = [key for _ in range(20) for key in all_keys(shake()[0])]
    assert len(set(keys)) == len(keys)
    assert KEY not in keys


def test_what_is_said_cannot_be_read_on_the_way() -> None:
    greeting, content = b"a greeting of the operator", b"a welcome of the robot"
    dialer = Dialer(KEY, greeting)
    answer, _ = Answerer(KEY, dialer.hello).answer(content)
    assert greeting not in dialer.hello
    assert content not in answer


def test_two_answers_to_one_call_have_different_keys() -> None:
    dialer = Dialer(KEY, b"")
    (_, first), (_, second) = (Answerer(KEY, dialer.hello).answer(b"") for _ in range(2))
    assert not set(all_keys(first)) & set(all_keys(second))


def test_a_call_with_another_key_is_refused() -> None:
    with pytest.raises(HandshakeError):
        Answerer(KEY, Dialer(OTHER_KEY, b"hello").hello)


def test_an_answer_with_another_key_is_refused() -> None:
    dialer = Dialer(KEY, b"")
    answer, _ = Answerer(OTHER_KEY, Dialer(OTHER_KEY, b"").hello).answer(b"")
    with pytest.raises(HandshakeError):
        dialer.finish(answer)


def test_an_answer_to_another_call_is_refused() -> None:
    answer, _ = Answerer(KEY, Dialer(KEY, b"").hello).answer(b"")
    with pytest.raises(HandshakeError):
        Dialer(KEY, b"").finish(answer)


def test_a_call_or_answer_of_another_protocol_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    dialer = Dialer(KEY, b"")
    with monkeypatch.context() as other:
        other.setattr(handshake, "_PROLOGUE", b"TAMS link 2")
        foreign = Dialer(KEY, b"").hello
        with pytest.raises(HandshakeError):
            Answerer(KEY, dialer.hello)
        answer, _ = Answerer(KEY, foreign).answer(b"")
    with pytest.raises(HandshakeError):
        dialer.finish(answer)
    with pytest.raises(HandshakeError):
        Answerer(KEY, foreign)


def test_every_flipped_bit_of_a_call_is_refused() -> None:
    for hello in flipped(Dialer(KEY, b"hi").hello):
        with pytest.raises(HandshakeError):
            Answerer(KEY, hello)


def test_every_flipped_bit_of_an_answer_is_refused() -> None:
    dialer = Dialer(KEY, b"")
    answer, _ = Answerer(KEY, dialer.hello).answer(b"ok")
    for spoilt in flipped(answer):
        with pytest.raises(HandshakeError):
            _copy(dialer).finish(spoilt)
    assert _copy(dialer).finish(answer)[0] == b"ok"


def _copy(dialer: Dialer) -> Dialer:
    """The same attempt once more: a wrong answer ends one."""
    again = Dialer(KEY, b"")
    state = dialer._noise.noise_protocol.handshake_state
    ours = again._noise.noise_protocol.handshake_state
    ours.e = state.e
    symmetric = ours.symmetric_state
    symmetric.h, symmetric.ck = state.symmetric_state.h, state.symmetric_state.ck
    symmetric.cipher_state.initialize_key(state.symmetric_state.cipher_state.k)
    symmetric.cipher_state.n = state.symmetric_state.cipher_state.n
    return again


@given(st.binary(max_size=200))
def test_anything_else_is_refused_and_raises_nothing_else(nonsense: bytes) -> None:
    with pytest.raises(HandshakeError):
        Answerer(KEY, nonsense)
    with pytest.raises(HandshakeError):
        Dialer(KEY, b"").finish(nonsense)


@pytest.mark.parametrize("length", [0, 31, 32, 47, 48, 65_507])
def test_a_call_of_any_length_is_refused(length: int) -> None:
    for filling in (b"\0", b"\xff"):  # the first: a point of low order
        with pytest.raises(HandshakeError):
            Answerer(KEY, filling * length)
        with pytest.raises(HandshakeError):
            Dialer(KEY, b"").finish(filling * length)


def test_a_truncated_call_or_answer_is_refused() -> None:
    dialer = Dialer(KEY, b"hello")
    answer, _ = Answerer(KEY, dialer.hello).answer(b"welcome")
    for length in range(len(dialer.hello)):
        with pytest.raises(HandshakeError):
            Answerer(KEY, dialer.hello[:length])
    for length in range(len(answer)):
        with pytest.raises(HandshakeError):
            _copy(dialer).finish(answer[:length])

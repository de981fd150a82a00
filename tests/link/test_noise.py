"""The handshake's two messages, by the published vectors and by what they must refuse."""

from __future__ import annotations

import pytest
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.noise import OVERHEAD_BYTES, Initiator, NoiseError, Responder, _first
from tests.link.rig import flipped

pytestmark = pytest.mark.untimed

# Noise_NNpsk0_25519_ChaChaPoly_SHA256 of cacophony's vectors (vectors/cacophony.txt of
# haskell-cryptography/cacophony, also in mcginty/snow and rweather/noise-c): inputs, two messages
# of the handshake, and four transport messages, which prove the keys of both directions.
SECRET = bytes.fromhex("54686973206973206d7920417573747269616e20706572737065637469766521")
PROLOGUE = bytes.fromhex("4a6f686e2047616c74")
INITIATOR = bytes.fromhex("893e28b9dc6ca8d611ab664754b8ceb7bac5117349a4439a6b0569da977c464a")
RESPONDER = bytes.fromhex("bbdb4cdbd309f1a1f2e1456967fe288cadd6f712d65dc7b7793d5e63da6b375b")
VECTOR = [
    (
        "4c756477696720766f6e204d69736573",
        "ca35def5ae56cec33dc2036731ab14896bc4c75dbb07a61f879f8e3afa4c7944"
        "79b962b8aff8485742ac32f905ba45369e2465fb59e138a93d67a0d1266b6a54",
    ),
    (
        "4d757272617920526f746862617264",
        "95ebc60d2b1fa672c1f46a8aa265ef51bfe38e7ccb39ec5be34069f144808843"
        "d6062704d5a9c422a8e834423f8c1feada7e8d0d910a1a2cd030fb584221e3",
    ),
    ("462e20412e20486179656b", "e632c3763d7669067383433197a3baddf146e9e70ad4b4e9e59e0f"),
    ("4361726c204d656e676572", "64c6bee32ea91c8474bb4c21d7a700109ad45af77b29764ba5eb1e"),
    (
        "4a65616e2d426170746973746520536179",
        "e2fa0bed0603b62d3ccac2ecabbf3fe33f3e86514909b323361626266cb2471cc8",
    ),
    (
        "457567656e2042f6686d20766f6e2042617765726b",
        "0c01dc9cec1fe4ddd692e8dd32188aa351088dc91183639a53b57aa4692b5ebdef8b8ca111",
    ),
]
EPHEMERAL, OTHER_EPHEMERAL = b"e" * 32, b"f" * 32


def begun(payload: bytes = b"") -> Initiator:
    return Initiator(SECRET, PROLOGUE, EPHEMERAL, payload)


def answered(message: bytes, payload: bytes = b"") -> bytes:
    return Responder(SECRET, PROLOGUE, message).answer(OTHER_EPHEMERAL, payload)[0]


def test_the_messages_are_those_of_the_published_vectors() -> None:
    payloads = [bytes.fromhex(payload) for payload, _ in VECTOR]
    messages = [bytes.fromhex(message) for _, message in VECTOR]
    initiator = Initiator(SECRET, PROLOGUE, INITIATOR, payloads[0])
    responder = Responder(SECRET, PROLOGUE, initiator.message)
    answer, split = responder.answer(RESPONDER, payloads[1])
    assert [initiator.message, answer] == messages[:2]
    assert responder.payload == payloads[0]
    assert initiator.finish(answer) == (payloads[1], split)
    for number, key in enumerate((split.initiator, split.responder) * 2):
        nonce = bytes(4) + (number // 2).to_bytes(8, "little")
        sealed = ChaCha20Poly1305(key).encrypt(nonce, payloads[2 + number], b"")
        assert sealed == messages[2 + number]


@given(st.binary(max_size=300), st.binary(max_size=300), st.binary(min_size=32, max_size=32))
def test_each_side_reads_what_the_other_says_and_both_have_the_same_keys(
    payload: bytes, answer: bytes, secret: bytes
) -> None:
    initiator = Initiator(secret, b"", EPHEMERAL, payload)
    responder = Responder(secret, b"", initiator.message)
    message, split = responder.answer(OTHER_EPHEMERAL, answer)
    assert responder.payload == payload
    assert initiator.finish(message) == (answer, split)
    assert len(initiator.message) == len(payload) + OVERHEAD_BYTES
    assert len({split.initiator, split.responder, split.handshake_hash, secret}) == 4


def test_a_wrong_answer_leaves_the_handshake_as_it_was() -> None:
    initiator = begun()
    answer = answered(initiator.message, b"ok")
    for spoilt in [*flipped(answer), *(answer[:length] for length in range(len(answer)))]:
        with pytest.raises(NoiseError):
            initiator.finish(spoilt)
    assert initiator.finish(answer)[0] == b"ok"


def test_every_flipped_bit_or_cut_of_the_first_message_is_refused() -> None:
    message = begun(b"hi").message
    cut = [message[:length] for length in range(len(message))]
    for spoilt in flipped(message) + cut[OVERHEAD_BYTES:]:
        with pytest.raises(NoiseError, match=r"^a message .+ that our secret did not make$"):
            Responder(SECRET, PROLOGUE, spoilt)
    for spoilt in cut[:OVERHEAD_BYTES]:
        with pytest.raises(NoiseError, match=r"^too short to be a message of the handshake$"):
            Responder(SECRET, PROLOGUE, spoilt)


@pytest.mark.parametrize("secret", [bytes(32), SECRET[:-1] + b"?"])
def test_another_secret_is_refused(secret: bytes) -> None:
    with pytest.raises(NoiseError):
        Responder(secret, PROLOGUE, begun().message)
    other = Initiator(secret, PROLOGUE, EPHEMERAL, b"")
    with pytest.raises(NoiseError):
        other.finish(answered(begun().message))


def test_another_prologue_and_an_answer_to_another_message_are_refused() -> None:
    with pytest.raises(NoiseError):
        Responder(SECRET, b"another", begun().message)
    answer = answered(Initiator(SECRET, PROLOGUE, OTHER_EPHEMERAL, b"").message)
    with pytest.raises(NoiseError):
        begun().finish(answer)


@pytest.mark.parametrize("length", [0, 31, 32, 47, 48, 65_507])
@pytest.mark.parametrize("filling", [b"\0", b"\xff"], ids=["low order", "ones"])
def test_nonsense_of_any_length_is_refused(length: int, filling: bytes) -> None:
    with pytest.raises(NoiseError):
        Responder(SECRET, PROLOGUE, filling * length)
    with pytest.raises(NoiseError):
        begun().finish(filling * length)


def test_a_public_key_of_low_order_is_refused_although_the_secret_made_the_message() -> None:
    zero = bytes(32)
    encrypted, _ = _first(SECRET, PROLOGUE, zero).sealed(b"")
    responder = Responder(SECRET, PROLOGUE, zero + encrypted)
    with pytest.raises(NoiseError, match=r"^a public key that leads to no secret$"):
        responder.answer(OTHER_EPHEMERAL, b"")

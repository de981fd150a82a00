"""The handshake's datagrams: nothing comes of them without the key, each session has its own."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.handshake import (
    BUSY,
    COOKIE_BYTES,
    INITIATION_BYTES,
    MAC_BYTES,
    NO_COOKIE,
    PADDING_BYTES,
    PROLOGUE,
    RESPONSE,
    TAG_BYTES,
    Cookies,
    SessionKeys,
    answer,
    filled,
    initiation,
    read_answer,
    read_initiation,
    session_keys,
    unfilled,
)
from tams_app.link.noise import Initiator, Responder, Split
from tams_app.units import NS_PER_S
from tests.link.rig import DESK, KEY, OTHER_KEY, ROBOT, flipped

pytestmark = pytest.mark.untimed

TAG = b"t" * TAG_BYTES
PAYLOAD = b"a payload"
KEYS = {KEY.identity: KEY}


def noise(seed: bytes = b"e" * 32) -> Initiator:
    return Initiator(KEY.secret, PROLOGUE, seed, PAYLOAD.ljust(PADDING_BYTES, b"\0"))


def all_keys(keys: SessionKeys) -> list[bytes]:
    return [keys.send.messages, keys.send.media, keys.receive.messages, keys.receive.media]


# --- keys -----------------------------------------------------------------------------------------


def test_all_versions_make_the_same_keys_of_a_handshake() -> None:
    """Known answers, by OpenSSL (HKDF, expand only): with others two versions could not talk."""
    split = Split(b"i" * 32, b"r" * 32, b"h" * 32)
    keys, theirs = (session_keys(split, initiator=initiator) for initiator in (True, False))
    assert (keys.number, keys.send, keys.receive) == (theirs.number, theirs.receive, theirs.send)
    assert keys.number.hex() == "50bfb896"
    assert [key.hex() for key in all_keys(keys)] == [
        "7671e84cc550eb898f25b6b4811d675d8934bd25757f93c1cebb40059f5e9df9",
        "7320c2b35676abf0f9543aa906b7c4fbd1924cabd178c894900f351ad12756e59e64cfeff577aa3007e24b46",
        "586edf24eed8b49ee49e8a5bbf549dc3d87dadec3abea99a2f84b75bcb41d44e",
        "32f18a1a9ba48c83005ae4383fa0f5c629e05cb467c642c0065e20e6f81c796c6f3a98c8cf2859cc63b8898a",
    ]


# --- initiations ----------------------------------------------------------------------------------


def test_an_initiation_is_read_as_it_was_made() -> None:
    cookie = b"c" * COOKIE_BYTES
    datagram = initiation(KEY, TAG, cookie, noise().message)
    assert len(datagram) == INITIATION_BYTES
    read = read_initiation(datagram, KEYS)
    assert read is not None
    assert (read.tag, read.key, read.cookie, read.noise) == (TAG, KEY, cookie, noise().message)
    responder = Responder(KEY.secret, PROLOGUE, read.noise)
    assert responder.payload.rstrip(b"\0") == PAYLOAD
    assert PAYLOAD not in datagram


def test_an_initiation_with_a_key_that_is_not_accepted_is_none() -> None:
    datagram = initiation(KEY, TAG, NO_COOKIE, noise().message)
    assert read_initiation(datagram, {OTHER_KEY.identity: OTHER_KEY}) is None
    assert read_initiation(datagram, {KEY.identity: OTHER_KEY}) is None
    assert read_initiation(datagram, {}) is None


def test_a_changed_initiation_is_none() -> None:
    datagram = initiation(KEY, TAG, NO_COOKIE, noise().message)
    assert read_initiation(datagram + b"\0", KEYS) is None
    for length in range(INITIATION_BYTES):
        assert read_initiation(datagram[:length], KEYS) is None
    for changed in flipped(datagram[1:], 7):  # the first byte is the kind, by which it gets here
        assert read_initiation(datagram[:1] + changed, KEYS) is None


# --- answers --------------------------------------------------------------------------------------


@given(st.binary(max_size=1200))
def test_an_answer_fits_its_initiation_alone(content: bytes) -> None:
    mac = b"m" * MAC_BYTES
    made = answer(RESPONSE, TAG, KEY, mac, content)
    assert read_answer(made, TAG, KEY, mac) == content
    assert read_answer(made, b"T" * TAG_BYTES, KEY, mac) is None
    assert read_answer(made, TAG, OTHER_KEY, mac) is None
    assert read_answer(made, TAG, KEY, b"M" * MAC_BYTES) is None
    assert read_answer(bytes((BUSY,)) + made[1:], TAG, KEY, mac) is None


def test_a_changed_answer_is_none() -> None:
    mac = b"m" * MAC_BYTES
    made = answer(RESPONSE, TAG, KEY, mac, b"content")
    changed = flipped(made) + [made[:length] for length in range(len(made))] + [made + b"\0"]
    assert {read_answer(one, TAG, KEY, mac) for one in changed} == {None}


@given(st.binary(max_size=300), st.integers(2, 300))
def test_what_is_filled_up_comes_back(content: bytes, size: int) -> None:
    assert unfilled(filled(content, size)) == content
    assert not any(filled(content, size)[2 + len(content) :])
    assert len(filled(content, size)) == max(size, len(content) + 2)


# --- cookies --------------------------------------------------------------------------------------


@given(st.integers(0, 10**15))
def test_a_cookie_is_valid_for_five_to_ten_seconds_at_its_address_alone(given_ns: int) -> None:
    cookies = Cookies(b"s" * 32)
    cookie = cookies.of(DESK, given_ns)
    assert len(cookie) == COOKIE_BYTES
    for later_ns, valid in ((0, True), (5 * NS_PER_S, True), (10 * NS_PER_S, False)):
        assert cookies.is_valid(cookie, DESK, given_ns + later_ns) == valid
    assert not cookies.is_valid(cookie, ROBOT, given_ns)
    assert not cookies.is_valid(cookie, (DESK[0], DESK[1] + 1), given_ns)
    assert not Cookies(b"t" * 32).is_valid(cookie, DESK, given_ns)
    assert not cookies.is_valid(NO_COOKIE, DESK, given_ns)

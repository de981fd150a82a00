"""Greetings and the words of a proof: what fits, and what fits nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.link.keys import LOOPBACK_KEY
from tams_app.link.proof import (
    Busy,
    Challenge,
    Meeting,
    Proof,
    Welcome,
    Word,
    WordStream,
    filled,
    framed,
    greeting,
    names_no_key,
    read_greeting,
    unfilled,
)
from tests.link.rig import KEY, OTHER_KEY, flipped

pytestmark = pytest.mark.untimed

KEYS = {KEY.identity: KEY}
NONCE = b"n" * 16
MEETING = Meeting(KEY, b"certificate", b"r" * 32, b"o" * 32)
WORDS: list[Word] = [
    Challenge(b"c" * 32),
    Proof(KEY.identity, b"n" * 32, b"m" * 32, bytes(258)),
    Welcome(bytes(1129), b"m" * 32),
    Busy(),
]


def test_a_greeting_names_its_key_and_not_its_secret() -> None:
    token = greeting(KEY, NONCE)
    assert read_greeting(token, KEYS) is KEY
    assert KEY.secret not in token
    assert read_greeting(token, {OTHER_KEY.identity: OTHER_KEY}) is None
    assert names_no_key(token, {OTHER_KEY.identity: OTHER_KEY})
    assert not names_no_key(token, KEYS)
    assert not names_no_key(token[:-1], {})
    assert not names_no_key(b"\x02" + token[1:], {})


def test_a_changed_greeting_is_none() -> None:
    token = greeting(KEY, NONCE)
    for changed in (
        *flipped(token),
        *(token[:length] for length in range(len(token))),
        token + b"x",
    ):
        assert read_greeting(changed, KEYS) is None


def test_no_part_of_a_meeting_can_be_another_and_the_mac_the_same() -> None:
    other = replace(KEY, name="kay")
    meetings = [
        MEETING,
        replace(MEETING, key=OTHER_KEY),
        replace(MEETING, key=replace(KEY, robot=b"s" * 32)),
        replace(MEETING, key=replace(KEY, robot=None)),
        replace(MEETING, certificate=b"another"),
        replace(MEETING, robots=b"s" * 32),
        replace(MEETING, operators=b"p" * 32),
    ]
    macs = [mac for one in meetings for mac in (one.proof(b"said"), one.welcome(b"said"))]
    macs.append(MEETING.proof(b"said more"))
    assert len(set(macs)) == len(macs)
    assert replace(MEETING, key=other).proof(b"said") == MEETING.proof(b"said")
    assert len(Meeting(LOOPBACK_KEY, b"", b"", b"").proof(b"")) == 32


@given(st.integers(1, 40))
def test_words_come_out_of_a_stream_however_it_is_cut(step: int) -> None:
    stream = b"".join(map(framed, WORDS))
    words, came = WordStream(), list[Word]()
    for at in range(0, len(stream), step):
        came += words.of(stream[at : at + step])
    assert came == WORDS
    assert not words.ended


@pytest.mark.parametrize(
    "wrong", [b"\0\0", b"\0\1\xc0", b"\xff\xff" + bytes(3000), b"\0\4\x91\xa3abc", bytes(100)]
)
def test_what_is_no_word_ends_the_stream(wrong: bytes) -> None:
    words = WordStream()
    assert words.of(framed(Busy()) + wrong + framed(Busy())) == [Busy()]
    assert words.ended
    assert words.of(framed(Busy())) == []


@given(st.binary(max_size=300))
def test_nonsense_raises_nothing(noise: bytes) -> None:
    words = WordStream()
    words.of(noise)
    assert len(words._rest) <= 300


@given(st.binary(max_size=40), st.integers(0, 50))
def test_what_is_filled_up_comes_back(content: bytes, size: int) -> None:
    whole = filled(content, size)
    assert len(whole) == size + 2
    assert unfilled(whole) == content[:size]
    assert unfilled(b"\0\x09abc") == b"abc"
    assert unfilled(b"") == b""

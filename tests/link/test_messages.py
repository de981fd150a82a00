"""Messages come back as they were, and what is none is refused whatever it is."""

from __future__ import annotations

import math
from contextlib import suppress
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.link.messages import (
    PROTOCOL,
    HandMessage,
    MessageError,
    SessionDescription,
    StateMessage,
    decode,
    encode,
)

pytestmark = pytest.mark.untimed

KINDS = (SessionDescription, HandMessage, StateMessage)
NS = st.integers(0, 2**62 - 1)
COUNT = st.integers(0, 2**31)
NUMBER = st.floats(allow_nan=False)
TEXT = st.text(max_size=20)
STRANGE = (math.nan, math.inf, -math.inf)

PLAIN = {type(None): st.none(), bool: st.booleans(), float: NUMBER, str: TEXT}


def built(kind: type[Any]) -> st.SearchStrategy[Any]:
    """Messages of that kind, or what is in one, with any values that their fields may have."""
    fields = get_type_hints(kind).items()
    return st.builds(kind, **{name: whatever(hint, name) for name, hint in fields})


def whatever(hint: Any, name: str) -> st.SearchStrategy[Any]:
    """What a field of that type may hold."""
    arguments = get_args(hint)
    if get_origin(hint) in (Union, UnionType):
        return st.one_of([whatever(one, name) for one in arguments])
    if get_origin(hint) is dict:
        return st.dictionaries(TEXT, whatever(arguments[1], name), max_size=3)
    if get_origin(hint) is tuple:
        if arguments[-1] is ...:
            return st.lists(whatever(arguments[0], name), max_size=4).map(tuple)
        return st.tuples(*[whatever(one, name) for one in arguments])
    if hint is object:
        return st.none() | st.booleans() | COUNT | TEXT
    if hint is int:
        return NS if name.endswith("_ns") or name == "operator" else COUNT
    return PLAIN[hint] if hint in PLAIN else built(hint)


welcomes, hands, states = map(built, KINDS)

HAND = HandMessage(
    operator=4711,
    simulated=False,
    sent_ns=5,
    echo_ns=3,
    echo_heard_ns=4,
    status="ok",
    pose=(0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0),
    pose_ns=5,
    buttons_ns=5,
    trigger=1.0,
    grip=0.0,
    a=False,
    b=False,
    menu=False,
    shown=(None, 3000),
    confirms=1,
    confirmed_ns=2,
    stops=0,
)

WELCOME = SessionDescription(
    protocol=PROTOCOL,
    version="2",
    session="a",
    name="robot",
    strategy="tams",
    network="none",
    seed=0,
    feedback=True,
    simulated=True,
    video={},
    repair={},
    hand_rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    workspace={},
    driving={},
    stopped_after_ms=350.0,
)


def fields(message: HandMessage) -> list[Any]:
    """A hand message as it is on the way: a list without names."""
    return list(msgspec.msgpack.decode(encode(message)))


NO_UTF8 = msgspec.Raw(b"\xa2\xff\xfe")  # a string of two bytes that are no text


def with_field(name: str, value: object) -> bytes:
    """A hand message whose field `name` is something else."""
    changed = fields(HAND)
    changed[HandMessage.__struct_fields__.index(name)] = value
    return msgspec.msgpack.encode(changed)


@settings(max_examples=50)
@given(welcomes | hands | states)
def test_messages_come_back_as_they_were(
    message: SessionDescription | HandMessage | StateMessage,
) -> None:
    assert decode(encode(message), type(message)) == message


@settings(max_examples=50)
@given(welcomes | hands | states, st.data())
def test_a_truncated_message_is_refused(
    message: SessionDescription | HandMessage | StateMessage, data: st.DataObject
) -> None:
    whole = encode(message)
    length = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(MessageError):
        decode(whole[:length], type(message))


@given(hands, st.binary(min_size=1, max_size=20))
def test_a_message_with_something_behind_it_is_refused(message: HandMessage, rest: bytes) -> None:
    with pytest.raises(MessageError):
        decode(encode(message) + rest, HandMessage)


WHOLE = [
    name
    for name in HandMessage.__struct_fields__
    if name.endswith("_ns") or name in ("operator", "confirms", "stops", "noted")
]


@pytest.mark.parametrize("value", [2**62, 2**63 - 1, 2**64 - 1, -(2**62), -(2**63)])
@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_number_of_which_a_difference_may_not_fit_into_64_bits_is_refused(
    name: str, value: int
) -> None:
    assert decode(with_field(name, 2**62 - 1), HandMessage)
    with pytest.raises(MessageError):
        decode(with_field(name, value), HandMessage)


@given(st.binary(max_size=300), st.sampled_from(KINDS))
def test_nonsense_is_refused_or_a_message_and_raises_nothing_else(
    nonsense: bytes, kind: type[HandMessage]
) -> None:
    with suppress(MessageError):
        assert isinstance(decode(nonsense, kind), kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_of_another_kind_is_refused(kind: type[HandMessage]) -> None:
    for message in (WELCOME, HAND):
        if type(message) is not kind:
            with pytest.raises(MessageError):
                decode(encode(message), kind)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, {}) for name in HandMessage.__struct_fields__),
        *(("sent_ns", value) for value in ("5", 5.5, None, *STRANGE)),
        ("status", NO_UTF8),
        ("pose", [0.1, 0.2, 0.3]),
        ("pose", [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0, 0.0]),
        ("trigger", True),
        ("a", 1),
        ("shown", [2**64 - 1]),
        ("presses", [1, 2, 3, 1 << 62]),
    ],
)
def test_a_field_of_another_type_is_refused(name: str, value: object) -> None:
    with pytest.raises(MessageError, match="no HandMessage"):
        decode(with_field(name, value), HandMessage)


@pytest.mark.parametrize("value", STRANGE)
def test_numbers_that_are_none_arrive_as_such_for_the_safety_logic_to_judge(value: float) -> None:
    pose = [value, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]
    message = decode(with_field("pose", pose), HandMessage)
    assert message.pose is not None
    assert repr(message.pose[0]) == repr(value)
    assert repr(decode(with_field("trigger", value), HandMessage).trigger) == repr(value)


def test_fields_that_a_later_version_adds_are_left_out() -> None:
    later = msgspec.msgpack.encode([*fields(HAND), "new", {"newer": 1}])
    assert decode(later, HandMessage) == HAND
    named = {**msgspec.msgpack.decode(encode(WELCOME)), "camera": "eih"}
    assert decode(msgspec.msgpack.encode(named), SessionDescription) == WELCOME


def test_a_message_without_what_is_asked_for_asks_for_nothing() -> None:
    short = decode(msgspec.msgpack.encode(fields(HAND)[:-9]), HandMessage)
    asked = short.confirms, short.confirmed_ns, short.stops, short.noted, short.presses
    assert asked == (0, 0, 0, 0, (0, 0, 0, 0))
    assert (short.hand, short.damaged, short.episodes) == ("", (), (0, 0, 0, 0, 0))
    with pytest.raises(MessageError):
        decode(msgspec.msgpack.encode(fields(HAND)[:-10]), HandMessage)


@pytest.mark.parametrize("depth", [100, 10_000])
def test_deeply_nested_nonsense_is_refused(depth: int) -> None:
    for kind in KINDS:
        with pytest.raises(MessageError):
            decode(b"\x91" * depth, kind)
    named = {**msgspec.msgpack.decode(encode(WELCOME)), "x": msgspec.Raw(b"\x91" * depth)}
    with pytest.raises(MessageError):
        decode(msgspec.msgpack.encode(named), SessionDescription)

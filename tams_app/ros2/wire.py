"""Records on their way to the bridge's process: a datagram each, in the log's own JSON."""

from __future__ import annotations

from typing import Any

import msgspec

from tams_app.recording.rates import RATES, Rates
from tams_app.recording.topics import TOPICS, Facts, FrameSent, Header, OutcomeGiven, Topic
from tams_app.records import (
    Allocation,
    EncodedFrame,
    Note,
    PhaseChange,
    SceneTruth,
    StopRecord,
    Tick,
)

EMERGENCY_STOP = "/tams/emergency_stop"  # the one topic that we receive
LONGEST_BYTES = 1 << 20  # of a datagram; a socket's own limit may be lower
STOP = b"stop"  # what comes back: somewhere in ROS the emergency stop was asked for

_LOGGED = (
    *(Header, Facts, Tick, SceneTruth, PhaseChange, Note, StopRecord, OutcomeGiven, FrameSent),
    Allocation,
)
_TOPICS: dict[type, Topic[Any]] = {one: TOPICS[one] for one in _LOGGED}
_TOPICS[Rates] = RATES
_BY_NAME = {one.__name__: topic for one, topic in _TOPICS.items()}


class _Datagram(msgspec.Struct, array_like=True):
    """A record's type, its JSON, and the bytes of an encoded frame."""

    name: str
    record: bytes
    data: bytes | None = None


def encode(record: Any) -> bytes | None:
    """None for a record of which ROS 2 receives nothing."""
    data = None
    if isinstance(record, EncodedFrame):
        record, data = FrameSent.of(record), record.data
    topic = _TOPICS.get(type(record))
    if topic is None:
        return None
    return msgspec.msgpack.encode(_Datagram(type(record).__name__, topic.encode(record), data))


def decode(content: bytes | memoryview) -> Any:
    """The record again."""
    datagram = msgspec.msgpack.decode(content, type=_Datagram)
    record = _BY_NAME[datagram.name].decode(datagram.record)
    return record if datagram.data is None else record.with_data(datagram.data)

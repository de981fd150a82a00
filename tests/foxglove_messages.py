"""Logs with Foxglove's messages, written, and read by the schema that lies in the file beside them.

What is read are plain values.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from tams_app.config import load_config
from tams_app.recording import Header
from tams_app.recording.journal import DirectRecorder
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.mcap_stream import protobuf_parts
from tams_app.runtime.clock import Clock, VirtualClock
from tams_app.session.viewing import viewers_of
from tams_app.units import NS_PER_MS
from tests.synthetic_session import START_NS, header

_MESSAGE, _BYTES, _STRING = 11, 12, 9
_DOUBLE, _BOOL, _ENUM = 1, 8, 14
_REPEATED = 3


@dataclass(frozen=True)
class Field:
    name: str
    kind: int
    type_name: str
    repeated: bool


Types = dict[str, dict[int, Field]]


def viewed_log(path: Path, head: Header, clock: Clock, **overrides: Any) -> DirectRecorder:
    """Writes a log with what viewers are shown, by a configuration with these keys."""
    viewers = viewers_of(load_config(None, overrides), head, live=False)
    return DirectRecorder(McapLog(path, head, True, *viewers), clock)


def write_viewed_log(
    path: Path,
    items: Iterable[Any],
    apart_ns: int = NS_PER_MS // 10,
    head: Header | None = None,
    **overrides: Any,
) -> Path:
    """A log with what viewers are shown of `items`, written so far apart."""
    clock = VirtualClock(START_NS)
    with closing(viewed_log(path, head or header(), clock, **overrides)) as log:
        for item in items:
            log.record(item)
            clock.advance_ns(apart_ns)
    return path


def messages(path: Path) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Topic, log time and content of each message of a log."""
    known: dict[int, Types] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.encoding == "jsonschema":
                content = json.loads(message.data)
            else:
                types = known.setdefault(schema.id, types_of(schema.data))
                content = decode(types, "." + schema.name, message.data)
            yield channel.topic, message.log_time, content


def types_of(descriptor_set: bytes) -> Types:
    """The message types of a FileDescriptorSet (descriptor.proto), by their full names."""
    types: Types = {}
    for number, file in protobuf_parts(descriptor_set):
        if number == 1:
            package = next((value.decode() for key, value in protobuf_parts(file) if key == 2), "")
            for key, value in protobuf_parts(file):
                if key == 4:
                    _add_type(types, f".{package}", value)
    return types


def _add_type(types: Types, scope: str, descriptor: bytes) -> None:
    parts = list(protobuf_parts(descriptor))
    name = f"{scope}." + next(value.decode() for key, value in parts if key == 1)
    types[name] = {}
    for key, value in parts:
        if key == 2:
            field = dict(protobuf_parts(value))
            types[name][field[3]] = Field(
                field[1].decode(), field[5], field.get(6, b"").decode(), field[4] == _REPEATED
            )
        elif key == 3:
            _add_type(types, name, value)


def decode(types: Types, name: str, data: bytes) -> dict[str, Any]:
    """A message; fields that are not in `data` have their defaults, messages are None then."""
    fields = types[name]
    content: dict[str, Any] = {one.name: _default(one) for one in fields.values()}
    for number, value in protobuf_parts(data):
        field = fields[number]
        if field.repeated and field.kind == _DOUBLE and isinstance(value, bytes):
            content[field.name] += [one for (one,) in struct.iter_unpack("<d", value)]
            continue
        plain = _plain(types, field, value)
        if field.repeated:
            content[field.name].append(plain)
        else:
            content[field.name] = plain
    return content


def _default(field: Field) -> Any:
    if field.repeated:
        return []
    defaults = {_MESSAGE: None, _STRING: "", _BYTES: b"", _DOUBLE: 0.0, _BOOL: False}
    return defaults.get(field.kind, 0)


def _plain(types: Types, field: Field, value: Any) -> Any:
    if field.kind == _MESSAGE:
        return decode(types, field.type_name, value)
    if field.kind == _STRING:
        return value.decode()
    if field.kind == _DOUBLE:
        return struct.unpack("<d", struct.pack("<Q", value))[0]
    return bool(value) if field.kind == _BOOL else value

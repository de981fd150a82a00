"""Logs with Foxglove's messages, written, and read by the schema that lies in the file beside them.

What is read are plain values.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from tams_app.config import load_config
from tams_app.recording import Header, wire
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.writer import DirectRecorder
from tams_app.runtime.clock import Clock
from tams_app.session.viewing import viewers_of

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


def viewed_log(path: Path, header: Header, clock: Clock, **overrides: Any) -> DirectRecorder:
    """Writes a log with what viewers are shown, by a configuration with these keys."""
    viewers = viewers_of(load_config(None, overrides), header, live=False)
    return DirectRecorder(McapLog(path, header, True, *viewers), clock)


def messages(path: Path) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Topic, log time and content of each message of a log."""
    known: dict[int, Types] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if schema.encoding == "jsonschema":
                content = json.loads(message.data)
            else:
                types = known.setdefault(schema.id, types_of(schema.data))
                content = decode(types, "." + schema.name, message.data)
            yield channel.topic, message.log_time, content


def types_of(descriptor_set: bytes) -> Types:
    """The message types of a FileDescriptorSet (descriptor.proto), by their full names."""
    types: Types = {}
    for number, file in wire.parts(descriptor_set):
        if number == 1:
            package = next((value.decode() for key, value in wire.parts(file) if key == 2), "")
            for key, value in wire.parts(file):
                if key == 4:
                    _add_type(types, f".{package}", value)
    return types


def _add_type(types: Types, scope: str, descriptor: bytes) -> None:
    parts = list(wire.parts(descriptor))
    name = f"{scope}." + next(value.decode() for key, value in parts if key == 1)
    types[name] = {}
    for key, value in parts:
        if key == 2:
            field = dict(wire.parts(value))
            types[name][field[3]] = Field(
                field[1].decode(), field[5], field.get(6, b"").decode(), field[4] == _REPEATED
            )
        elif key == 3:
            _add_type(types, name, value)


def decode(types: Types, name: str, data: bytes) -> dict[str, Any]:
    """A message; fields that are not in `data` have their defaults, messages are None then."""
    fields = types[name]
    content: dict[str, Any] = {one.name: _default(one) for one in fields.values()}
    for number, value in wire.parts(data):
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

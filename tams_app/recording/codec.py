"""From frozen records to JSON and back, and their JSON schemas, all derived from the type hints.

Enums become their values, arrays become lists, rotations quaternions (x, y, z, w). JSON has no
NaN: a number that is not finite is written as null and read back as NaN.
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
import numpy as np

from tams_app.rotation import Rotation

T = TypeVar("T")
Convert = Callable[[Any], Any]

_SCHEMA_NAMES = {int: "integer", float: "number", bool: "boolean", str: "string"}


class Codec(Generic[T]):
    """Writes and reads records of one dataclass.

    TypeError if a field cannot be recorded, or is not described.
    """

    def __init__(self, record_type: type[T]) -> None:
        self.record_type = record_type
        self._form = _record(record_type)

    def schema(self) -> bytes:
        """The JSON schema of the record."""
        return json.dumps({"title": self.record_type.__name__, **self._form.schema}).encode()

    def encode(self, record: T) -> bytes:
        """One JSON object. A tick takes 12 µs; it is written beside a loop of 120 Hz."""
        return _ENCODER.encode(record)

    def decode(self, data: bytes) -> T:
        """Raises KeyError, TypeError or ValueError if `data` is not such a record."""
        record: T = self._form.read(msgspec.json.decode(data))
        return record


def _plain(value: Any) -> Any:
    """What the encoder does not know by itself."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be recorded")


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


class _Form(NamedTuple):
    """A type in JSON: its schema, and how a value is read; None: it is taken as it is."""

    schema: dict[str, Any]
    convert: Convert | None = None

    def read(self, tree: Any) -> Any:
        return tree if self.convert is None else self.convert(tree)


_NUMBERS = {"type": "array", "items": {"type": "number"}}


def _form(hint: Any) -> _Form:
    """msgspec reads no null as a number, and its schemas have unions, which viewers do not know."""
    hint = _unaliased(hint)
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (part for part in parts if part is not type(None))
        return _optional(_form(inner))
    if origin is dict:
        return _mapping(_form(parts[0]), _form(parts[1]))
    if origin is tuple:
        return _sequence(_form(parts[0]))
    if origin is np.ndarray:
        return _Form(_NUMBERS, partial(np.array, dtype=np.float64))  # null becomes NaN
    if hint is Rotation:
        return _Form(_NUMBERS, _read_rotation)
    if isinstance(hint, type) and issubclass(hint, Enum):
        values = [member.value for member in hint]
        return _Form({"type": _SCHEMA_NAMES[type(values[0])], "enum": values}, hint)
    if dataclasses.is_dataclass(hint):
        return _record(typing.cast(type, hint))
    if hint is Any:
        return _Form({})
    if hint not in _SCHEMA_NAMES:
        raise TypeError(f"a {hint} cannot be recorded")
    return _Form({"type": _SCHEMA_NAMES[hint]}, _read_float if hint is float else None)


def _unaliased(hint: Any) -> Any:
    """What a `type` statement names (PEP 695), such as NDArray of numpy 2.5; other hints as are."""
    while hasattr(hint, "__value__"):
        parts = typing.get_args(hint)
        hint = hint.__value__[parts] if parts else hint.__value__
    return hint


def _optional(inner: _Form) -> _Form:
    convert = inner.convert
    if convert is None:
        return inner
    return _Form(inner.schema, lambda tree: None if tree is None else convert(tree))


def _mapping(key: _Form, value: _Form) -> _Form:
    schema = {"type": "object", "additionalProperties": value.schema}
    if key.convert is None and value.convert is None:
        return _Form(schema)
    return _Form(
        schema, lambda tree: {key.read(name): value.read(one) for name, one in tree.items()}
    )


def _sequence(item: _Form) -> _Form:
    schema, convert = {"type": "array", "items": item.schema}, item.convert
    return _Form(schema, tuple if convert is None else lambda tree: tuple(map(convert, tree)))


def _read_float(tree: Any) -> float:
    return math.nan if tree is None else float(tree)


def _read_rotation(tree: list[float | None]) -> Rotation:
    """A rotation that was not finite when recorded cannot be represented: identity stands in."""
    numbers = [number for number in tree if number is not None]
    return Rotation.from_quat(numbers) if len(numbers) == len(tree) else Rotation.identity()


def _record(record_type: type) -> _Form:
    hints = typing.get_type_hints(record_type, include_extras=True)
    forms: list[tuple[str, Convert | None]] = []
    properties: dict[str, Any] = {}
    for field in dataclasses.fields(record_type):
        name, hint = field.name, hints[field.name]
        if typing.get_origin(hint) is not typing.Annotated:
            raise TypeError(f"{record_type.__name__}.{name} is not described")
        form = _form(hint.__origin__)
        forms.append((name, form.convert))
        properties[name] = {**form.schema, "description": hint.__metadata__[0]}

    def read(tree: dict[str, Any]) -> Any:
        # a field added since the log was written takes its default
        return record_type(
            **{
                name: tree[name] if convert is None else convert(tree[name])
                for name, convert in forms
                if name in tree
            }
        )

    return _Form({"type": "object", "properties": properties}, read)

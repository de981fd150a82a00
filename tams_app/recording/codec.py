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
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np

from tams_app.recording.descriptions import description
from tams_app.records import Activity, ArmState, FrameQuality, ServoMode
from tams_app.rotation import Rotation

T = TypeVar("T")
Convert = Callable[[Any], Any]

_SCHEMA_NAMES = {int: "integer", float: "number", bool: "boolean", str: "string"}


class Codec(Generic[T]):
    """Writes and reads records of one dataclass."""

    def __init__(self, record_type: type[T]) -> None:
        self.record_type = record_type
        self._schema = _schema(
            record_type
        )  # raises where a field cannot be recorded, or is not described
        self._decode = _record_decoder(record_type)

    def schema(self) -> bytes:
        """The JSON schema of the record."""
        return json.dumps({"title": self.record_type.__name__, **self._schema}).encode()

    def encode(self, record: T) -> bytes:
        """One JSON object. A tick takes 12 µs; it is written beside a loop of 120 Hz."""
        return _ENCODER.encode(record)

    def decode(self, data: bytes) -> T:
        """Raises KeyError, TypeError or ValueError if `data` is not such a record."""
        record: T = self._decode(msgspec.json.decode(data))
        return record


def _plain(value: Any) -> Any:
    """What the encoder does not know by itself."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot be recorded")


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


def _hints(record_type: type) -> list[tuple[str, Any]]:
    hints = typing.get_type_hints(record_type)
    return [(field.name, hints[field.name]) for field in dataclasses.fields(record_type)]


def _optional(hint: Any) -> Any:
    """X of a hint `X | None`, else None."""
    if typing.get_origin(hint) not in (typing.Union, types.UnionType):
        return None
    (inner,) = (part for part in typing.get_args(hint) if part is not type(None))
    return inner


def _unless_none(convert: Convert | None) -> Convert | None:
    return None if convert is None else lambda tree: None if tree is None else convert(tree)


def _decoder(hint: Any) -> Convert | None:
    """How a value of this type is read; None if it is taken as it is."""
    if inner := _optional(hint):
        return _unless_none(_decoder(inner))
    origin = typing.get_origin(hint)
    if origin is dict:
        return _dict_decoder(*typing.get_args(hint))
    if origin is tuple:
        convert = _decoder(typing.get_args(hint)[0])
        return tuple if convert is None else lambda tree: tuple(map(convert, tree))
    if origin is np.ndarray:
        return lambda tree: np.array(tree, dtype=np.float64)  # null becomes NaN
    if hint is Rotation:
        return _decode_rotation
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint
    if dataclasses.is_dataclass(hint):
        return _record_decoder(typing.cast(type, hint))
    if hint is float:
        return lambda tree: math.nan if tree is None else float(tree)
    return None


def _dict_decoder(key_hint: Any, value_hint: Any) -> Convert | None:
    convert_key, convert = _decoder(key_hint), _decoder(value_hint)
    if convert_key is None and convert is None:
        return None
    return lambda tree: {
        convert_key(key) if convert_key else key: convert(item) if convert else item
        for key, item in tree.items()
    }


def _decode_rotation(tree: list[float | None]) -> Rotation:
    """A rotation that was not finite when recorded cannot be represented: identity stands in."""
    numbers = [number for number in tree if number is not None]
    return Rotation.from_quat(numbers) if len(numbers) == len(tree) else Rotation.identity()


def _record_decoder(record_type: type) -> Convert:
    fields = [(name, _decoder(hint)) for name, hint in _hints(record_type)]
    upgrade = UPGRADES.get(record_type)

    def decode(tree: dict[str, Any]) -> Any:
        if upgrade is not None:
            tree = upgrade(tree)
        # a field added since the log was written takes its default
        return record_type(
            **{
                name: tree[name] if convert is None else convert(tree[name])
                for name, convert in fields
                if name in tree
            }
        )

    return decode


def _schema(hint: Any) -> dict[str, Any]:
    if inner := _optional(hint):
        return _schema(inner)  # viewers do not understand unions; null stays allowed in practice
    origin = typing.get_origin(hint)
    if origin is dict:
        return {"type": "object", "additionalProperties": _schema(typing.get_args(hint)[1])}
    if origin is tuple:
        return {"type": "array", "items": _schema(typing.get_args(hint)[0])}
    if origin is np.ndarray or hint is Rotation:
        return {"type": "array", "items": {"type": "number"}}
    if isinstance(hint, type) and issubclass(hint, Enum):
        values = [member.value for member in hint]
        return {"type": _SCHEMA_NAMES[type(values[0])], "enum": values}
    if dataclasses.is_dataclass(hint):
        return {"type": "object", "properties": _properties(typing.cast(type, hint))}
    if hint is Any:
        return {}
    if hint not in _SCHEMA_NAMES:
        raise TypeError(f"a {hint} cannot be recorded")
    return {"type": _SCHEMA_NAMES[hint]}


def _properties(record_type: type) -> dict[str, Any]:
    return {
        name: {**_schema(hint), "description": description(record_type.__name__, name)}
        for name, hint in _hints(record_type)
    }


# Up to 0.1 an arm's state was told in the numbers of the only controller there was.
_ACTIVITIES = {0: Activity.IDLE, 1: Activity.MOVING, 2: Activity.IDLE, 3: Activity.PAUSED}
_SERVO_MODES = {1: ServoMode.POSE, 5: ServoMode.VELOCITY}


def _arm_state(logged: dict[str, Any]) -> dict[str, Any]:
    if "error_code" not in logged:
        return logged
    code = logged["error_code"]
    return {
        **logged,
        "activity": _ACTIVITIES.get(logged["state"], Activity.STOPPED),
        "servo": _SERVO_MODES.get(logged["mode"]),
        "fault": {"code": code, "text": f"C{code}"} if code else None,
    }


def _frame_quality(logged: dict[str, Any]) -> dict[str, Any]:
    """Up to 0.1, `damaged` was what `concealed` is now."""
    if "damaged" not in logged:
        return logged
    return {**logged, "concealed": logged["damaged"]}


UPGRADES: dict[type, Callable[[dict[str, Any]], dict[str, Any]]] = {
    ArmState: _arm_state,
    FrameQuality: _frame_quality,
}

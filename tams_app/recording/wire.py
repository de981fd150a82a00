"""Just enough of the protobuf wire format to read fields back from Foxglove's messages.

Source: protobuf.dev, "Encoding": a field is a varint key (number << 3 | type) and its value.
"""

from __future__ import annotations

from collections.abc import Iterator

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def fields(message: bytes) -> dict[int, int | bytes]:
    """Field number to value; of a repeated field the last value stays. Errors as of `parts`."""
    return dict(parts(message))


def parts(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Each field's number and value: integers for varint and fixed fields, bytes for the rest.

    Raises ValueError if `message` is damaged.
    """
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            found, at = _varint(message, at)
            yield number, found
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_FIXED32, _FIXED64):
            size = 4 if kind == _FIXED32 else 8
        else:
            raise ValueError(f"unknown protobuf wire type {kind}")
        value = message[at : at + size]
        if len(value) < size:
            raise ValueError("the protobuf message is cut off")
        yield number, value if kind == _BYTES else int.from_bytes(value, "little")
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if at >= len(message):
            raise ValueError("the protobuf message is cut off")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7

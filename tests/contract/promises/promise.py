"""Promises of a device: functions of a bench, which say in their names what is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias, TypeVar

from tams_app.errors import DeviceError

Bench = TypeVar("Bench")
Promise: TypeAlias = Callable[[Bench], None]


def require(holds: bool, otherwise: str) -> None:
    """AssertionError with the sentence `otherwise` unless a condition holds."""
    assert holds, otherwise


def refused(action: Callable[[], object]) -> None:
    """AssertionError unless an action raises a `DeviceError` of one line."""
    try:
        action()
    except DeviceError as error:
        require(len(str(error).splitlines()) == 1, f"is refused in several lines: {error}")
        return
    raise AssertionError("is not refused: a DeviceError was expected")

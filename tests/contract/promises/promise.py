"""Promises of a device: functions of a bench, which say in their names what is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias, TypeVar

from tams_app.errors import DeviceError

Bench = TypeVar("Bench")
Promise: TypeAlias = Callable[[Bench], None]


def require(holds: bool, otherwise: str) -> None:
    """Fail a promise unless a condition holds.

    Args:
        holds: the condition.
        otherwise: the sentence of the error.

    Raises:
        AssertionError: it does not hold.
    """
    assert holds, otherwise


def refused(action: Callable[[], object]) -> None:
    """Fail a promise unless an action is refused.

    Args:
        action: must raise a `DeviceError` of one line.

    Raises:
        AssertionError: it does not, or in several lines.
    """
    try:
        action()
    except DeviceError as error:
        require(len(str(error).splitlines()) == 1, f"is refused in several lines: {error}")
        return
    raise AssertionError("is not refused: a DeviceError was expected")

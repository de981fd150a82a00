"""Promises of a device: functions of a bench, which say in their names what is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import TypeAlias, TypeVar

from tams_app.errors import DeviceError, TamsError

Bench = TypeVar("Bench")
Promise: TypeAlias = Callable[[Bench], None]


class ContractError(TamsError):
    """A device does not do what its interface says."""


def require(holds: bool, otherwise: str) -> None:
    """ContractError with `otherwise` unless it `holds`."""
    if not holds:
        raise ContractError(otherwise)


def refused(action: Callable[[], object], words: str = "") -> None:
    """ContractError unless `action` raises a DeviceError of one line that has `words`."""
    try:
        action()
    except DeviceError as error:
        require(len(str(error).splitlines()) == 1, f"is refused in several lines: {error}")
        require(words in str(error), f"is refused without the word {words!r}: {error}")
        return
    raise ContractError("is not refused: a DeviceError was expected")


def check(
    promises: Sequence[Promise[Bench]], make_bench: Callable[[], AbstractContextManager[Bench]]
) -> None:
    """Check each promise on a bench of its own; ContractError with a line for each not kept."""
    broken = []
    for promise in promises:
        with make_bench() as bench:
            try:
                promise(bench)
            except TamsError as error:
                broken.append(f"{promise.__name__.replace('_', ' ')}: {error}")
    if broken:
        raise ContractError("\n".join(broken))

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


def refused(action: Callable[[], object]) -> None:
    """ContractError unless `action` raises a DeviceError of one line."""
    try:
        action()
    except DeviceError as error:
        require(len(str(error).splitlines()) == 1, f"is refused in several lines: {error}")
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
            except Exception as error:  # noqa: BLE001  the others are checked all the same
                what = str(error) if isinstance(error, TamsError) else repr(error)
                broken.append(f"{promise.__name__.replace('_', ' ')}: {what}")
    if broken:
        raise ContractError("\n".join(broken))

"""Promises of a device: functions of a bench, which say in their names what is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import TypeAlias, TypeVar

from tams_app.errors import DeviceError, TamsError

Bench = TypeVar("Bench")
Promise: TypeAlias = Callable[[Bench], None]


class ContractError(TamsError):
    """A device breaks its interface's contract: a line for each promise that is not kept."""


def require(holds: bool, otherwise: str) -> None:
    """Fail a promise unless a condition holds.

    Args:
        holds: the condition.
        otherwise: the sentence of the error.

    Raises:
        ContractError: it does not hold.
    """
    if not holds:
        raise ContractError(otherwise)


def refused(action: Callable[[], object]) -> None:
    """Fail a promise unless an action is refused.

    Args:
        action: must raise a `DeviceError` of one line.

    Raises:
        ContractError: it does not, or in several lines.
    """
    try:
        action()
    except DeviceError as error:
        require(len(str(error).splitlines()) == 1, f"is refused in several lines: {error}")
        return
    raise ContractError("is not refused: a DeviceError was expected")


def check(
    promises: Sequence[Promise[Bench]], make_bench: Callable[[], AbstractContextManager[Bench]]
) -> None:
    """Check each promise on a bench of its own.

    Args:
        promises: functions of a bench, whose names are the sentences that errors begin with.
        make_bench: makes a bench and, on leaving the context, releases what belongs to it.

    Raises:
        ContractError: a line for each promise that is not kept; all are checked all the same.
    """
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

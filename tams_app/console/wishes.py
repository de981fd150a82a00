"""What people ask of a session by key or button, and what is done then."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Protocol, TypeAlias

from tams_app.robot.confirmation import CONFIRMED_AGO_NS, TOO_LONG_AGO

Action: TypeAlias = Callable[[], None]


class Wish(StrEnum):
    """What is asked for; the last three by the experimenter, in a trial of a study."""

    CONFIRM = "confirm"
    EMERGENCY_STOP = "emergency stop"
    QUIT = "quit"
    CLOSE = "close"
    DROP = "a drop more"
    NO_DROP = "a drop less"
    PLACED = "placed"


class Signals(Protocol):
    """What the operator asks of the arm."""

    def confirm(self, asked_ns: int | None = None) -> None: ...

    def estop(self) -> None: ...


class AskedSession(Protocol):
    """A session of which something is asked."""

    @property
    def signals(self) -> Signals: ...

    def end(self, reason: str) -> None: ...

    def note(self, level: str, text: str) -> None: ...


_NONE: Mapping[Wish, Action] = MappingProxyType({})


def actions_of(session: AskedSession, more: Mapping[Wish, Action] = _NONE) -> Mapping[Wish, Action]:
    """What to do for each wish but a confirmation, in any thread; `more`: in a trial."""
    return {
        Wish.EMERGENCY_STOP: session.signals.estop,
        Wish.QUIT: lambda: session.end("ended by the operator"),
        Wish.CLOSE: lambda: session.end("the operator closed the window"),
        **more,
    }


def carry_out(
    session: AskedSession,
    actions: Mapping[Wish, Action],
    wish: Wish,
    asked_ns: int,
    now_ns: int,
) -> None:
    """Do what is wished for; what `actions` lacks changes nothing.

    A confirmation counts for a while only: `asked_ns` is when the operator gave it at the earliest,
    however long it waited for an application that stood still.
    """
    if wish is not Wish.CONFIRM:
        if action := actions.get(wish):
            action()
    elif now_ns - asked_ns > CONFIRMED_AGO_NS:
        session.note("warning", TOO_LONG_AGO)
    else:
        session.signals.confirm(asked_ns)

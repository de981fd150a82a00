"""What people ask of a session by key or button, and what is done then."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Protocol, TypeAlias

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

    def confirm(self) -> None: ...

    def estop(self) -> None: ...


class AskedSession(Protocol):
    """A session of which something is asked."""

    @property
    def signals(self) -> Signals: ...

    def end(self, reason: str) -> None: ...


_NONE: Mapping[Wish, Action] = MappingProxyType({})


def actions_of(session: AskedSession, more: Mapping[Wish, Action] = _NONE) -> Mapping[Wish, Action]:
    """What to do for each wish, in any thread; `more`: in a trial. Others change nothing."""
    return {
        Wish.CONFIRM: session.signals.confirm,
        Wish.EMERGENCY_STOP: session.signals.estop,
        Wish.QUIT: lambda: session.end("ended by the operator"),
        Wish.CLOSE: lambda: session.end("the operator closed the window"),
        **more,
    }

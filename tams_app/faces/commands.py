"""The commands that people give a session by key or button, and their actions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import partial
from types import MappingProxyType
from typing import Protocol, TypeAlias

from tams_app.records import EpisodeRequest, Phase

Action: TypeAlias = Callable[[], None]
PHASE_KEYS: Mapping[str, Phase | None] = MappingProxyType(
    {str(number): phase for number, phase in enumerate(Phase, start=1)} | {"0": None}
)
"""Which phase each key marks in a replay; None: nothing that counts."""


class Command(StrEnum):
    """A command: the session's, those of episodes, and the experimenter's in a trial of a study."""

    CONFIRM = "confirm"
    EMERGENCY_STOP = "emergency stop"
    QUIT = "quit"
    CLOSE = "close"
    EPISODE = "episode"
    DISCARD = "discard"
    REDO = "redo"
    SUCCESS = "success"
    FAILURE = "failure"
    DROP = "a drop more"
    NO_DROP = "a drop less"
    PLACED = "placed"


LETTERS: Mapping[str, Command] = MappingProxyType(
    {
        "q": Command.QUIT,
        "e": Command.EPISODE,
        "z": Command.DISCARD,
        "u": Command.REDO,
        "y": Command.SUCCESS,
        "n": Command.FAILURE,
        "x": Command.DROP,
        "p": Command.PLACED,
    }
)
"""The commands of letter keys, in the window as on the terminal."""


class OperatorSignals(Protocol):
    """The operator's signals to arm and log."""

    pinned: str
    """The view that they have pinned; "": none."""

    def confirm(self, asked_ns: int) -> None: ...

    def estop(self) -> None: ...

    def episode(self, request: EpisodeRequest) -> None: ...


class CommandedSession(Protocol):
    """A session of which something is asked."""

    @property
    def signals(self) -> OperatorSignals: ...

    def end(self, reason: str) -> None: ...

    def note(self, level: str, text: str) -> None: ...


_OF_EPISODES = {
    Command.EPISODE: EpisodeRequest.NEXT,
    Command.DISCARD: EpisodeRequest.DISCARD,
    Command.REDO: EpisodeRequest.REDO,
    Command.SUCCESS: EpisodeRequest.SUCCESS,
    Command.FAILURE: EpisodeRequest.FAILURE,
}
_NONE: Mapping[Command, Action] = MappingProxyType({})


def actions_of(
    session: CommandedSession, more: Mapping[Command, Action] = _NONE
) -> Mapping[Command, Action]:
    """The action of each command but a confirmation, for any thread; `more`: in a trial."""
    return {
        Command.EMERGENCY_STOP: session.signals.estop,
        Command.QUIT: lambda: session.end("ended by the operator"),
        Command.CLOSE: lambda: session.end("the operator closed the window"),
        **{
            command: partial(session.signals.episode, request)
            for command, request in _OF_EPISODES.items()
        },
        **more,
    }


def carry_out(
    session: CommandedSession,
    actions: Mapping[Command, Action],
    command: Command,
    asked_ns: int,
) -> None:
    """Carry out a command; what `actions` lacks changes nothing.

    `asked_ns` is when the operator gave it at the earliest, however long it waited for an
    application that stood still.
    """
    if command is Command.CONFIRM:
        session.signals.confirm(asked_ns)
    elif action := actions.get(command):
        action()

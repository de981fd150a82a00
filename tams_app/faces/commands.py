"""The commands that people give a session by key or button, and the signals that they cause."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Protocol

from tams_app.records import EpisodeRequest, Phase

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

OF_EPISODES: Mapping[Command, EpisodeRequest] = MappingProxyType(
    {
        Command.EPISODE: EpisodeRequest.NEXT,
        Command.DISCARD: EpisodeRequest.DISCARD,
        Command.REDO: EpisodeRequest.REDO,
        Command.SUCCESS: EpisodeRequest.SUCCESS,
        Command.FAILURE: EpisodeRequest.FAILURE,
    }
)
"""The commands of episodes."""


class OperatorSignals(Protocol):
    """The operator's signals to arm and log."""

    pinned: str
    """The view that they have pinned; "": none."""

    def confirm(self, asked_ns: int) -> None: ...

    def estop(self) -> None: ...

    def episode(self, request: EpisodeRequest) -> None: ...

"""The folder of clips: which there are, from which sessions, and what was left out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tams_app.config.problems import describe_validation_error
from tams_app.config.reader import read_yaml
from tams_app.errors import ConfigError, LogError
from tams_app.records import Phase

_INDEX = "clips.yaml"
_HEADER = "# Written by `run_tams.py calibrate weights`: what each clip shows.\n"


@dataclass(frozen=True, slots=True)
class Clip:
    """One phase of one session, all views side by side."""

    path: Path
    phase: Phase
    session: str
    seconds: float


class CutSession(BaseModel):
    """What was cut from one session; times in seconds from its start."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    recorded: str  # UTC
    shows: Annotated[str, Field(alias="picture")]  # the quality of the frames, in words
    constrained: bool  # not at full quality, as the paper's were
    rig: bool = False  # recorded on the simulated rig
    context_s: float  # shown before and after each phase
    too_short: int  # segments left out
    not_longest: int  # segments left out
    clips: dict[Phase, ClipTimes]


class ClipTimes(BaseModel):
    """Where in its session a clip is."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start_s: float
    seconds: float


class _Index(BaseModel):
    model_config = ConfigDict(extra="forbid")

    sessions: dict[str, CutSession] = {}


class ClipFolder:
    """The clips and their index."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def sessions(self) -> dict[str, CutSession]:
        """What was cut so far, by session; ConfigError if the index was spoilt."""
        index = self.path / _INDEX
        if not index.is_file():
            return {}
        try:
            return _Index.model_validate(read_yaml(index)).sessions
        except ValidationError as error:
            raise ConfigError(f"{index}: {describe_validation_error(error)}") from error

    def there(self) -> dict[str, CutSession]:
        """The same, without the clips that were not finished or are gone."""
        return {
            name: session.model_copy(
                update={
                    "clips": {
                        phase: times
                        for phase, times in session.clips.items()
                        if self.file(phase, name).is_file()
                    }
                }
            )
            for name, session in self.sessions().items()
        }

    def clips(self) -> list[Clip]:
        """Every clip that is there, by phase and session."""
        found = [
            Clip(self.file(phase, name), phase, name, times.seconds)
            for name, session in self.there().items()
            for phase, times in session.clips.items()
        ]
        order = list(Phase)
        return sorted(found, key=lambda clip: (order.index(clip.phase), clip.session))

    def file(self, phase: Phase, session: str) -> Path:
        """Where the clip of a phase of a session is, or will be."""
        return self.path / f"{phase.value}-{session}.mp4"

    def add(self, name: str, session: CutSession) -> None:
        """Enter a session before its clips are cut; those that were cut otherwise before go.

        ConfigError if another session has its name.
        """
        known = self.sessions()
        if name in known:
            self._remove_outdated(name, known[name], session)
        content = _Index(sessions=known | {name: session}).model_dump(mode="json", by_alias=True)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            temporary = self.path / f".{_INDEX}.new"
            text = _HEADER + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
            temporary.write_text(text, encoding="utf-8")
            os.replace(temporary, self.path / _INDEX)
        except OSError as error:
            raise LogError(f"{self.path}: cannot be written: {error.strerror}") from error

    def _remove_outdated(self, name: str, before: CutSession, now: CutSession) -> None:
        if before.recorded != now.recorded:
            raise ConfigError(
                f"{self.path / _INDEX}: knows another session named {name}: rename one folder"
            )
        for phase, times in before.clips.items():
            if now.clips.get(phase) != times or before.shows != now.shows:
                self.file(phase, name).unlink(missing_ok=True)

"""One YAML file per rater: made once, then only ever added to: no answer is lost or changed.

rater: p01
simulated: false
scale: [1, 5]
answers:
- {phase: REACH, necessity: {eih: 2, gt: 5, gs: 3}, most_critical: gt}
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calibration.weights.ratings import LEAST, MOST, Answer, Sheet
from tams_app.config.problems import describe_validation_error
from tams_app.config.reader import read_yaml
from tams_app.errors import ConfigError, LogError
from tams_app.records import Phase

PSEUDONYM = re.compile(r"[A-Za-z0-9_-]{1,40}")
_SUFFIX = ".yaml"


class _AnswerFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    phase: Phase
    necessity: dict[str, Annotated[int, Field(ge=LEAST, le=MOST, strict=True)] | None]
    most_critical: str | None


class _SheetFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    rater: Annotated[str, Field(pattern=f"^{PSEUDONYM.pattern}$")]
    simulated: bool
    scale: tuple[Literal[1], Literal[5]]
    answers: list[_AnswerFile] | None


class RatingFolder:
    """The raters' files in one folder; `views` are those that must be rated."""

    def __init__(self, path: Path, views: Sequence[str]) -> None:
        self.path = path
        self._views = tuple(views)

    def sheets(self) -> list[Sheet]:
        """What all raters have said; ConfigError if a file is not as it must be."""
        return [self._read(file) for file in sorted(self.path.glob(f"*{_SUFFIX}"))]

    def open(self, rater: str, simulated: bool = False) -> Sheet:
        """What `rater` has said so far; his file is made if he has none yet.

        ConfigError if the name cannot be one, is another kind of rater's, or if his file was
        written in a way that nothing can be added to.
        """
        if not PSEUDONYM.fullmatch(rater):
            raise ConfigError(
                f"{rater!r} cannot be a rater's name: take a short pseudonym of letters, digits, "
                "- and _, such as p01"
            )
        file = self._file(rater)
        head = (
            f"# The ratings of one person or simulated rater; only ever added to.\n"
            f"rater: {_flow(rater)}\nsimulated: {_flow(simulated)}\nscale: [{LEAST}, {MOST}]\n"
            "answers:\n"
        )
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with file.open("x", encoding="utf-8") as new:
                new.write(head)
        except FileExistsError:
            sheet = self._read(file)
            if sheet.simulated != simulated:
                raise ConfigError(
                    f"{file}: belongs to another kind of rater; take another name"
                ) from None
            _with_line(file, "{}")  # before he answers, not after
            return sheet
        except OSError as error:
            raise LogError(f"{file}: cannot be written: {error.strerror}") from error
        return Sheet(rater, simulated, ())

    def add(self, rater: str, answer: Answer) -> None:
        """Append one answer to the disk; ConfigError if this phase is answered already.

        ConfigError also where nothing can be added to the file.
        """
        file = self._file(rater)
        if self._read(file).on(answer.phase) is not None:
            raise ConfigError(f"{file}: {answer.phase.value} is answered already, and stays so")
        line = {
            "phase": answer.phase.value,
            "necessity": dict(answer.necessity),
            "most_critical": answer.most_critical,
        }
        added = _with_line(file, _flow(line))
        try:
            with file.open("a", encoding="utf-8") as sheet:
                sheet.write(added)
                sheet.flush()
                os.fsync(sheet.fileno())
        except OSError as error:
            raise LogError(f"{file}: cannot be written: {error.strerror}") from error

    def _file(self, rater: str) -> Path:
        return self.path / f"{rater}{_SUFFIX}"

    def _read(self, file: Path) -> Sheet:
        try:
            content = _SheetFile.model_validate(read_yaml(file))
        except ValidationError as error:
            raise ConfigError(f"{file}: {describe_validation_error(error)}") from error
        if content.rater != file.stem:
            raise ConfigError(f"{file}: rater: is {content.rater}; the file must bear that name")
        answers = tuple(
            Answer(one.phase, one.necessity, one.most_critical) for one in content.answers or ()
        )
        self._check(file, answers)
        return Sheet(content.rater, content.simulated, answers)

    def _check(self, file: Path, answers: Sequence[Answer]) -> None:
        """Each phase once, and all and only the configuration's views."""
        phases = [answer.phase for answer in answers]
        for answer in answers:
            where = f"{file}: {answer.phase.value}"
            if phases.count(answer.phase) > 1:
                raise ConfigError(f"{where}: is answered twice; keep the first answer")
            if set(answer.necessity) != set(self._views):
                raise ConfigError(f"{where}: necessity must name {', '.join(self._views)}")
            if answer.most_critical not in (*self._views, None):
                raise ConfigError(f"{where}: most_critical must be one of {', '.join(self._views)}")


def _with_line(file: Path, line: str) -> str:
    """The text that adds `line` to the answers in `file`; ConfigError if that would spoil it.

    A file written by hand may lack its last line's end, indent its list or close it with `]`.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise LogError(f"{file}: cannot be read: {error.strerror}") from error
    added = f"- {line}\n" if text.endswith("\n") else f"\n- {line}\n"
    try:
        answers = yaml.safe_load(text + added)["answers"]
    except yaml.YAMLError as error:
        raise ConfigError(
            f"{file}: cannot be added to: write `answers:` on a line of its own, and below it each "
            "answer on one line that begins with `- `"
        ) from error
    assert answers[-1] == yaml.safe_load(line)
    return added


def _flow(value: Any) -> str:
    """One line of YAML; JSON is that, and quotes what YAML would take for something else."""
    text = json.dumps(value)
    assert yaml.safe_load(text) == value
    return text

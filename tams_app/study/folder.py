"""A study's folder: plan.json, config.yaml and a folder per attempt. Nothing is ever overwritten
but the plan, and that in one step, so that a crash at any point leaves a study that goes on."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tams_app.config import Config, dump_config, load_config
from tams_app.config.section import describe_validation_error
from tams_app.errors import ConfigError, LogError
from tams_app.outputs import inner_folder, open_lock, write_file
from tams_app.study.plan import Attempt, AttemptState, ParticipantState, Plan
from tams_app.study.runner import MACHINE_NAME, SUMMARY_NAME

PLAN_NAME = "plan.json"
CONFIG_NAME = "config.yaml"
TRIALS_NAME = "trials"
TABLES_NAME = "tables"
REPORT_NAME = "report"
_LOCK_NAME = ".lock"


class StudyFolder:
    """Reads and writes one study; LogError where the disk refuses, ConfigError on a wrong plan."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def exists(self) -> bool:
        """True if there is a plan."""
        return (self.path / PLAN_NAME).is_file()

    def create(self, plan: Plan, config: Config) -> None:
        """Write a new study; ConfigError if there is one already."""
        with _reported(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        with self.locked():
            if self.exists:
                raise ConfigError(f"{self.path}: holds a study already: choose another folder")
            write_file(self.path / CONFIG_NAME, dump_config(config))
            self.save(plan)

    def config(self) -> Config:
        """The configuration as it was when the study was planned."""
        return load_config(self.path / CONFIG_NAME)

    def load(self) -> Plan:
        """The plan as it stands; ConfigError if there is none or it is not one of ours."""
        path = self.path / PLAN_NAME
        try:
            return Plan.model_validate_json(path.read_bytes())
        except FileNotFoundError as error:
            raise ConfigError(
                f"{self.path}: holds no {PLAN_NAME}: make one with `study plan`"
            ) from error
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
        except ValidationError as error:
            raise ConfigError(f"{path}: {describe_validation_error(error, Plan)}") from error

    def save(self, plan: Plan) -> None:
        """Put `plan` in the place of the old one in one step."""
        write_file(self.path / PLAN_NAME, plan.model_dump_json(indent=1) + "\n")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other commands from this study; ConfigError if one works on it."""
        handle = open_lock(self.path / _LOCK_NAME)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(handle)
            raise ConfigError(
                f"{self.path}: another command works on this study: let it finish, or stop it"
            ) from error
        try:
            yield
        finally:
            os.close(handle)

    @contextmanager
    def opened(self) -> Iterator[Plan]:
        """The plan, with what a crash left open settled, kept from other commands meanwhile."""
        self.load()  # a folder without a study is not locked
        with self.locked():
            yield self.recover()

    def settle(self, plan: Plan, trial_id: str, attempt: Attempt, **changes: Any) -> Plan:
        """The plan with a changed attempt, as it is kept from now on."""
        plan = plan.with_attempt(trial_id, attempt.model_copy(update=changes))
        self.save(plan)
        return plan

    def new_attempt(self, plan: Plan, trial_id: str) -> tuple[Plan, Attempt]:
        """Make a folder that never was and note the attempt in the plan."""
        trial = plan.trial(trial_id)
        number = len(trial.attempts) + 1
        while True:
            parent = inner_folder(self.path, TRIALS_NAME, trial.participant)
            relative = parent.relative_to(self.path) / f"{trial_id}-a{number}"
            with _reported(self.path):
                try:
                    (self.path / relative).mkdir()
                    break
                except FileExistsError:  # a crash came before it was noted
                    number += 1
        attempt = Attempt(folder=relative.as_posix())
        return self.settle(plan, trial_id, attempt), attempt

    def recover(self) -> Plan:
        """The plan, in which what a crash or an interruption left open is settled.

        That is attempts, and who is forgotten. On hardware the verdict on an attempt that ran to
        its end is due.
        """
        recovered = plan = self.load()
        ended = AttemptState.DONE if plan.simulated else AttemptState.RAN
        for trial in plan.trials:
            attempt = trial.last
            if attempt is None or attempt.state is not AttemptState.STARTED:
                continue
            if self.has_ended(attempt):
                change: dict[str, Any] = {"state": AttemptState.DONE if trial.practice else ended}
            else:
                change = {"state": AttemptState.INTERRUPTED, "reason": "the study was stopped"}
            recovered = recovered.with_attempt(trial.id, attempt.model_copy(update=change))
        if recovered is not plan:
            self.save(recovered)
        for person in recovered.participants:
            if person.state is ParticipantState.BEING_FORGOTTEN:
                recovered = self._finish_forgetting(recovered, person.id)
        return recovered

    def summary(self, attempt: Attempt) -> dict[str, Any] | None:
        """The attempt's summary.json, None where there is none or it is not whole."""
        summary = self._content(attempt, SUMMARY_NAME)
        return summary if "outcome" in summary else None

    def processor(self, attempt: Attempt) -> str | None:
        """The processor that an attempt ran on, None where it does not say."""
        return self._content(attempt, MACHINE_NAME).get("processor")

    def _content(self, attempt: Attempt, name: str) -> dict[str, Any]:
        """The object in a file of an attempt, an empty one where there is none."""
        try:
            content = json.loads((self.path / attempt.folder / name).read_bytes())
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def has_ended(self, attempt: Attempt) -> bool:
        """True if the attempt ran to its end and left a whole summary."""
        marked = (self.path / attempt.folder / MACHINE_NAME).is_file()
        return marked and self.summary(attempt) is not None

    def forget(self, plan: Plan, pseudonym: str) -> Plan:
        """Delete a participant's trials and everything computed from all trials.

        Their place in the design stays in the plan as forgotten; the others' trials are untouched.
        """
        person = plan.participant(pseudonym)
        marked = person.model_copy(update={"state": ParticipantState.BEING_FORGOTTEN})
        self.save(plan.with_participant(marked))
        return self._finish_forgetting(plan, pseudonym)

    def _finish_forgetting(self, plan: Plan, pseudonym: str) -> Plan:
        with _reported(self.path):
            for inside in ((TRIALS_NAME, pseudonym), (TABLES_NAME,), (REPORT_NAME,)):
                if self.path.joinpath(*inside).exists():
                    shutil.rmtree(inner_folder(self.path, *inside))
        gone = plan.participant(pseudonym).model_copy(update={"state": ParticipantState.FORGOTTEN})
        plan = plan.with_participant(gone).without_trials_of(pseudonym)
        self.save(plan)
        return plan


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LogError(f"{path}: cannot be written ({error.strerror})") from error

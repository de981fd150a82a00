"""The plan of a study as it is kept in plan.json: who does what in which order, and what became
of it. Values never change: each transition gives a new plan."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tams_app.config import Config
from tams_app.config.section import NonNegative, Section
from tams_app.errors import ConfigError
from tams_app.outputs import is_plain_name

PARTICIPANT_PATTERN = r"^P[0-9]{2,4}$"


def _plain_name(text: str) -> str:
    if not is_plain_name(text):
        raise ValueError("must be a plain name, for folders are named after it")
    return text


def _inner_path(text: str) -> str:
    if not all(map(is_plain_name, text.split("/"))):
        raise ValueError("must be a folder within that of the study")
    return text


class AttemptState(StrEnum):
    """The state of one attempt at a trial."""

    STARTED = "started"
    RAN = "ran"  # to its end; an experimenter's verdict is due
    DONE = "done"
    VOID = "void"  # judged not to count, with a reason
    FAILED = "failed"  # an error, with a reason
    INTERRUPTED = "interrupted"  # the study was stopped while it ran


class ParticipantState(StrEnum):
    """The state of a participant: takes part, being forgotten, forgotten."""

    TAKES_PART = "takes part"
    BEING_FORGOTTEN = "being forgotten"  # a crash may come between the files and the plan
    FORGOTTEN = "forgotten"


class Verdict(Section):
    """An experimenter's verdict on a trial (docs/GLOSSARY.md)."""

    completed: bool
    success: bool
    drops: Annotated[int, Field(ge=0)]
    completion_time_s: NonNegative | None = None


class Attempt(Section):
    """One attempt; `folder` is relative to the study's. Attempts are never deleted or reused."""

    folder: Annotated[str, AfterValidator(_inner_path)]
    state: AttemptState = AttemptState.STARTED
    reason: str = ""
    verdict: Verdict | None = None


class PlannedTrial(Section):
    """One trial; `order` counts from 1 within its participant, repetitions from 1.

    Practice trials have repetition 0 and are never analysed. `seed`: of scene, noise and losses,
    shared by the strategies of one participant, network and repetition; `participant_seed`: who the
    simulated participant is, the same in all their trials.
    """

    id: Annotated[str, AfterValidator(_plain_name)]
    participant: Annotated[str, Field(pattern=PARTICIPANT_PATTERN)]
    order: Annotated[int, Field(ge=1)]
    strategy: str
    network: str
    repetition: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0)]
    participant_seed: Annotated[int, Field(ge=0)]
    attempts: tuple[Attempt, ...] = ()

    @property
    def practice(self) -> bool:
        return self.repetition == 0

    @property
    def last(self) -> Attempt | None:
        """The newest attempt."""
        return self.attempts[-1] if self.attempts else None

    @property
    def is_done(self) -> bool:
        return self.last is not None and self.last.state is AttemptState.DONE

    def configure(self, config: Config) -> Config:
        """The study's configuration with this trial's name, seed and condition."""
        changes = {
            "name": self.id,
            "seed": self.seed,
            "strategy": self.strategy,
            "network": self.network,
        }
        return conditions_of_all(config).model_copy(update=changes)


def conditions_of_all(config: Config) -> Config:
    """The study's configuration with what is the same in all trials.

    Budget and repair are those of the section `study`.
    """
    budget = config.policy.budget.model_copy(update={"mode": config.study.budget})
    repair = config.video.repair.model_copy(update={"mode": config.study.repair})
    changes = {
        "policy": config.policy.model_copy(update={"budget": budget}),
        "video": config.video.model_copy(update={"repair": repair}),
    }
    return config.model_copy(update=changes)


class Participant(Section):
    """A participant under a pseudonym; `sequence` is their row of the Latin square."""

    id: Annotated[str, Field(pattern=PARTICIPANT_PATTERN)]
    sequence: Annotated[int, Field(ge=0)]
    state: ParticipantState = ParticipantState.TAKES_PART


class Plan(Section):
    """A whole study. `simulated`: the rig with its simulated operator, not people."""

    schema_version: Literal[1] = 1
    name: str
    seed: Annotated[int, Field(ge=0)]
    simulated: bool
    strategies: tuple[str, ...]
    networks: tuple[str, ...]
    reference: str
    proposed: str
    repetitions: Annotated[int, Field(ge=1)]
    participants: tuple[Participant, ...]
    trials: tuple[PlannedTrial, ...]

    @model_validator(mode="after")
    def _ids_are_unique(self) -> Self:
        ids = [trial.id for trial in self.trials]
        if len(set(ids)) < len(ids):
            raise ValueError("trials: two have the same id")
        return self

    def trial(self, trial_id: str) -> PlannedTrial:
        """The trial of that id; ConfigError if there is none."""
        for trial in self.trials:
            if trial.id == trial_id:
                return trial
        raise ConfigError(f"{trial_id}: the plan has no such trial: see `study show`")

    def participant(self, pseudonym: str) -> Participant:
        """The participant under that pseudonym; ConfigError lists who takes part."""
        for participant in self.participants:
            if participant.id == pseudonym:
                return participant
        names = ", ".join(one.id for one in self.participants)
        raise ConfigError(f"{pseudonym}: is no participant of this study ({names})")

    @property
    def left(self) -> tuple[PlannedTrial, ...]:
        """The trials still to be run, in order."""
        return tuple(trial for trial in self.trials if not trial.is_done)

    def with_attempt(self, trial_id: str, attempt: Attempt) -> Plan:
        """The plan with one more attempt at a trial, or with that attempt's new state."""
        trial = self.trial(trial_id)
        kept = tuple(one for one in trial.attempts if one.folder != attempt.folder)
        changed = trial.model_copy(update={"attempts": (*kept, attempt)})
        trials = tuple(changed if one.id == trial_id else one for one in self.trials)
        return self.model_copy(update={"trials": trials})

    def with_participant(self, participant: Participant) -> Plan:
        """The plan with that participant's new state."""
        everyone = tuple(
            participant if one.id == participant.id else one for one in self.participants
        )
        return self.model_copy(update={"participants": everyone})

    def without_trials_of(self, pseudonym: str) -> Plan:
        """The plan without a participant's trials; their place in the design stays."""
        kept = tuple(trial for trial in self.trials if trial.participant != pseudonym)
        return self.model_copy(update={"trials": kept})


def void(plan: Plan, trial_id: str, reason: str) -> Plan:
    """Declare the last attempt at a trial void, so that it is taken again; its data stay.

    ConfigError without a reason, or where there is nothing to declare void.
    """
    attempt = plan.trial(trial_id).last
    if not reason.strip():
        raise ConfigError(f"{trial_id}: say why it is void: the reason is kept")
    if attempt is None or attempt.state not in (AttemptState.DONE, AttemptState.RAN):
        raise ConfigError(f"{trial_id}: has no finished attempt that could be void")
    changed = attempt.model_copy(update={"state": AttemptState.VOID, "reason": reason.strip()})
    return plan.with_attempt(trial_id, changed)

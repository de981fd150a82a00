"""The interface between a study and what runs its trials, live or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tams_app.config import Config
from tams_app.study.plan import PlannedTrial

SUMMARY_NAME = "summary.json"
LOG_NAME = "session.mcap"


@dataclass(frozen=True, slots=True)
class TrialSpec:
    """One trial, ready to run.

    `seed`: of scene, noise and losses, shared by the strategies of one participant, network and
    repetition; `participant_seed`: who the simulated participant is, the same in all their trials.
    """

    trial_id: str
    participant: str
    strategy: str
    network: str
    repetition: int  # from 1; 0 in practice
    practice: bool
    seed: int
    participant_seed: int

    @staticmethod
    def of(trial: PlannedTrial) -> TrialSpec:
        return TrialSpec(
            trial.id,
            trial.participant,
            trial.strategy,
            trial.network,
            trial.repetition,
            trial.practice,
            trial.seed,
            trial.participant_seed,
        )

    def configure(self, config: Config) -> Config:
        """The study's configuration with this trial's name, seed, strategy and network."""
        changes = {
            "name": self.trial_id,
            "seed": self.seed,
            "strategy": self.strategy,
            "network": self.network,
        }
        return config.model_copy(update=changes)


class TrialRunner(Protocol):
    """Runs one trial. Pickled into a process of its own where trials run in parallel."""

    def run(self, spec: TrialSpec, folder: Path) -> None:
        """Leave summary.json and the log in `folder`, which exists and is empty but for logs.

        Raises TamsError, a sentence, where the trial cannot be run.
        """

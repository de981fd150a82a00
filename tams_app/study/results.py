"""What came of each trial, read from the study's folder once."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from tams_app.config import Config
from tams_app.study.folder import StudyFolder
from tams_app.study.machine import MACHINE_NAME
from tams_app.study.plan import Plan, PlannedTrial
from tams_app.study.statistics.intervals import means_by_unit

SSIM_KINDS = ("received_ssim", "delivered_ssim", "live_ssim")


@dataclass(frozen=True, slots=True)
class TrialResult:
    """One finished trial. The experimenter's verdict stands before the simulator's.

    `relied_on`: by phase, each view's share of what the operator's glances told him, where known.
    """

    trial: PlannedTrial
    folder: Path
    summary: Mapping[str, Any]
    machine: Mapping[str, str]
    completed: bool | None
    success: bool | None
    completion_time_s: float | None
    drops: int | None

    @property
    def strategy(self) -> str:
        return self.trial.strategy

    @property
    def network(self) -> str:
        return self.trial.network

    @property
    def participant(self) -> str:
        return self.trial.participant

    def censored_time_s(self, limit_s: float) -> float | None:
        """The completion time, the limit where the block was not placed; None if not judged."""
        if self.completed and self.completion_time_s is not None:
            return min(self.completion_time_s, limit_s)
        return limit_s if self.completed is False else None

    @property
    def completed_time_s(self) -> float | None:
        return self.completion_time_s if self.completed else None

    def primary_ssim(self, kind: str, phase: str | None = None) -> float | None:
        """Of the primary view: the mean of the phases' means, or of one phase."""
        if phase is not None:
            return self._of_phase(phase, kind)
        value = (self.summary.get("primary_view") or {}).get(kind)
        return None if value is None else float(value)

    @property
    def time_weighted_ssim(self) -> float | None:
        """Received, of the primary view: each phase for as long as it lasted."""
        primary = self.summary.get("primary_view") or {}
        value = (primary.get("time_weighted") or {}).get("received_ssim")
        return None if value is None else float(value)

    def damaged_fraction(self, phase: str) -> float | None:
        """Share of the primary view's shown frames that loss damaged."""
        return self._of_phase(phase, "damaged_fraction")

    @property
    def packets_per_frame(self) -> float | None:
        """Of the primary view, mean of the phases."""
        known = [
            packets
            for phase in self.phases
            if (packets := self._of_phase(phase, "packets_per_frame")) is not None
        ]
        return sum(known) / len(known) if known else None

    @property
    def coding_ssim(self) -> float | None:
        """Received SSIM of the primary view's undamaged frames, mean of phases that have any."""
        return self._mean_of_parted("undamaged_received_ssim")

    @property
    def parted_ssim(self) -> float | None:
        """Received SSIM of the primary view over the same phases."""
        return self._mean_of_parted("received_ssim")

    @property
    def lost_ssim(self) -> float | None:
        """What loss took of it: the difference of the two, seldom above 0."""
        received, coding = self.parted_ssim, self.coding_ssim
        return None if received is None or coding is None else received - coding

    @property
    def parted_phases(self) -> tuple[str, ...]:
        """Those with an undamaged frame: of the others nobody knows what coding took."""
        return tuple(
            phase
            for phase in self.phases
            if self._of_phase(phase, "undamaged_received_ssim") is not None
            and self._of_phase(phase, "received_ssim") is not None
        )

    def _mean_of_parted(self, key: str) -> float | None:
        known = [
            value
            for phase in self.parted_phases
            if (value := self._of_phase(phase, key)) is not None
        ]
        return sum(known) / len(known) if known else None

    def _of_phase(self, phase: str, key: str) -> float | None:
        by_phase = (self.summary.get("primary_view") or {}).get("by_phase", {})
        value = (by_phase.get(phase) or {}).get(key)
        return None if value is None else float(value)

    @property
    def phases(self) -> tuple[str, ...]:
        """Those with a score of the primary view."""
        return tuple((self.summary.get("primary_view") or {}).get("by_phase", {}))

    @property
    def all_views_ssim(self) -> float | None:
        """Received, mean over all views and all their frames, whichever is primary."""
        views = (self.summary.get("views") or {}).values()
        known = [one["received_ssim"] for one in views if one.get("received_ssim") is not None]
        return sum(known) / len(known) if known else None

    @property
    def phase_seconds(self) -> Mapping[str, float]:
        """How long each phase lasted in all."""
        changes = self.summary.get("phases") or []
        end = {"t_s": self.summary.get("duration_s")}
        found: dict[str, float] = {}
        for change, later in pairwise((*changes, end)):
            found.setdefault(change["phase"], 0.0)
            found[change["phase"]] += later["t_s"] - change["t_s"]
        return found

    @property
    def glance_agreement(self) -> float | None:
        """The fraction of glances in which W's primary view told the operator most."""
        operator = self.summary.get("operator") or {}
        value = (operator.get("relied_on") or {}).get("agreement")
        return None if value is None else float(value)

    @property
    def relied_on(self) -> Mapping[str, Mapping[str, float]]:
        operator = self.summary.get("operator") or {}
        return dict((operator.get("relied_on") or {}).get("by_phase") or {})

    @property
    def uncertainty_mm(self) -> Mapping[str, Mapping[str, float]]:
        """The simulated operator's, by stage of his task: percentiles; empty where not known."""
        return (self.summary.get("operator") or {}).get("uncertainty_mm") or {}


@dataclass(frozen=True, slots=True)
class StudyData:
    """A plan, its configuration, and every result; practice is kept apart."""

    plan: Plan
    config: Config
    results: tuple[TrialResult, ...]
    practice: tuple[TrialResult, ...]
    unreadable: tuple[str, ...]  # ids of trials that are done, but whose summary is gone

    @property
    def limit_s(self) -> float:
        return self.config.trial.limit_s

    def of(self, strategy: str, network: str) -> list[TrialResult]:
        """The results of one condition in the plan's order."""
        return [one for one in self.results if (one.strategy, one.network) == (strategy, network)]


def read_results(study: StudyFolder) -> StudyData:
    """Everything a report is made of; ConfigError if the folder holds no study."""
    plan = study.load()
    found = {trial.id: _read(study, trial) for trial in plan.trials if trial.is_done}
    there = [result for result in found.values() if result is not None]
    return StudyData(
        plan,
        study.config(),
        tuple(result for result in there if not result.trial.practice),
        tuple(result for result in there if result.trial.practice),
        tuple(trial_id for trial_id, result in found.items() if result is None),
    )


def participant_means(
    results: Sequence[TrialResult], values: Sequence[float | None]
) -> list[float]:
    """One mean per participant of the values that are there."""
    groups: dict[str, list[float]] = {}
    for result, value in zip(results, values, strict=True):
        if value is not None:
            groups.setdefault(result.participant, []).append(value)
    return means_by_unit(groups)


def _read(study: StudyFolder, trial: PlannedTrial) -> TrialResult | None:
    attempt = trial.last
    summary = study.summary(attempt) if attempt else None
    if attempt is None or summary is None:
        return None
    said = summary["outcome"]
    judged = attempt.verdict.model_dump() if attempt.verdict else said
    folder = study.path / attempt.folder
    return TrialResult(
        trial,
        folder,
        summary,
        _machine(folder),
        judged["completed"],
        judged["success"],
        judged["completion_time_s"],
        judged["drops"],
    )


def _machine(folder: Path) -> dict[str, str]:
    try:
        content = json.loads((folder / MACHINE_NAME).read_bytes())
    except (OSError, ValueError):
        return {}
    return {str(key): str(value) for key, value in content.items()}

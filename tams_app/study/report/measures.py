"""The numbers that a report's template and figures ask for, by strategy and network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.study.results import StudyData
from tams_app.study.statistics.differences import (
    PairedDifference,
    Welch,
    paired_difference,
    welch,
)
from tams_app.study.statistics.intervals import Estimate, mean_interval, wilson_interval
from tams_app.study.statistics.mixed_model import MixedModel, NotFitted, fit_mixed_model
from tams_app.study.tables import PHASES, SSIM_KINDS

_SHORTEST_PHASE_S = 0.005  # a tick lasts .0083 s


@dataclass(frozen=True, slots=True)
class Measures:
    """Estimates over participants are those of participants' means: repetitions count once."""

    data: StudyData

    @property
    def others(self) -> tuple[str, ...]:
        """Every strategy but the proposed one."""
        plan = self.data.plan
        return tuple(one for one in plan.strategies if one != plan.proposed)

    @property
    def weights(self) -> WeightMatrix:
        return WeightMatrix(self.data.config.policy.weights.matrix)

    def primary_view(self, phase: str) -> str:
        """The view with the largest weight in a phase."""
        return self.weights.primary_view(Phase(phase))

    def mean(self, strategy: str, network: str, column: str) -> Estimate | None:
        """A trial's value: mean and interval over participants."""
        return _over_participants(self.data.of(strategy, network), column)

    def phase_mean(
        self, strategy: str, network: str, phase: str, column: str = "received_ssim"
    ) -> Estimate | None:
        """A value of one phase: mean and interval over participants."""
        return _over_participants(self.data.phases_of(strategy, network, phase), column)

    def relied_on(self, phase: str, view: str) -> Estimate | None:
        """A view's share of what the operator's glances told in a phase, over all conditions."""
        rows = self.data.phases[self.data.phases["phase"] == phase]
        return _over_participants(rows, f"relied_on_{view}_fraction")

    def values(self, strategy: str, network: str, column: str) -> list[float]:
        """Each trial's value that is there."""
        found = self.data.of(strategy, network)
        return _floats(found[column]) if column in found else []

    def trials_mean(self, strategy: str, network: str, column: str) -> Estimate | None:
        """Mean and interval over trials."""
        return mean_interval(self.values(strategy, network, column))

    def median(self, strategy: str, network: str, column: str) -> float | None:
        """The median over trials."""
        found = self.values(strategy, network, column)
        return float(np.median(found)) if found else None

    def views_mean(self, strategy: str, network: str, column: str) -> float | None:
        """The mean over trials of the mean over the views, of columns such as eih_`column`."""
        found = self.data.of(strategy, network)
        columns = [f"{view}_{column}" for view in self.data.config.video.views]
        means = found.reindex(columns=columns).mean(axis=1).dropna()
        return float(means.mean()) if len(means) else None

    def share(self, strategy: str, network: str, column: str) -> Estimate | None:
        """The share of trials of which a column of true and false is true."""
        known = self.values(strategy, network, column)
        return wilson_interval(round(sum(known)), len(known))

    def difference(self, other: str, network: str, column: str) -> PairedDifference:
        """Proposed minus `other`, on pairs of trials that share everything else."""
        return self._paired(self.data.trials, other, network, column, ["repetition"])

    def phase_difference(
        self, other: str, network: str, phase: str | None = None
    ) -> PairedDifference:
        """The same of received SSIM in one phase, or in the mean of those that both trials have."""
        rows = self.data.phases
        rows = rows if phase is None else rows[rows["phase"] == phase]
        return self._paired(rows, other, network, "received_ssim", ["repetition", "phase"])

    def welch(self, network: str) -> Welch | None:
        """The paper's test: proposed against reference, times of completed trials."""
        plan = self.data.plan
        if plan.proposed == plan.reference:
            return None
        first, second = (
            self.values(one, network, "completion_time_s")
            for one in (plan.proposed, plan.reference)
        )
        return welch(first, second)

    def model(self, column: str) -> MixedModel | NotFitted:
        """column ~ strategy × network + (1 | participant); reference strategy, first network."""
        plan = self.data.plan
        levels = (plan.reference, *(one for one in plan.strategies if one != plan.reference))
        rows = self.data.trials.dropna(subset=[column])
        rows = pd.DataFrame(
            {
                "value": rows[column].astype(float),
                "strategy": pd.Categorical(rows["strategy"], levels),
                "network": pd.Categorical(rows["network"], plan.networks),
                "participant": rows["participant"].astype(str),
            }
        )
        return fit_mixed_model(rows, "value ~ strategy * network")

    def is_hit_by_loss(self, network: str) -> bool:
        """Whether loss left any frame of a primary view there incomplete."""
        rows = self.data.phases[self.data.phases["network"] == network]
        return bool((rows["damaged_fraction"].fillna(0) > 0).any())

    def median_phases_s(self) -> dict[str, float]:
        """How long each phase lasted; empty where the tables lack phases without a scored frame."""
        lasted = self.data.phases.pivot_table(index="trial", columns="phase", values="duration_s")
        whole_s = self.data.trials.set_index("trial")["duration_s"]
        if ((whole_s - lasted.sum(axis=1)).fillna(np.inf) > _SHORTEST_PHASE_S).any():
            return {}
        medians = lasted.reindex(index=whole_s.index, columns=PHASES).fillna(0.0).median()
        return {str(phase): float(seconds) for phase, seconds in medians.items()}

    def unscored(self, phase: str) -> int:
        """In how many trials no frame of the primary view was scored in a phase."""
        rows = self.data.phases[self.data.phases["phase"] == phase]
        scored = rows[list(SSIM_KINDS)].notna().any(axis=1)
        return len(self.data.trials) - int(scored.sum())

    @property
    def phases_without_complete_frames(self) -> int:
        """Phases with scored frames of which each was incomplete, in all trials."""
        scored = self.data.phases[self.data.phases["received_ssim"].notna()]
        return int(scored["undamaged_received_ssim"].isna().sum())

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages of the simulated operator's task of which the uncertainty is known."""
        columns = [str(one) for one in self.data.trials.columns]
        return tuple(
            one.removeprefix("uncertainty_").removesuffix("_mm")
            for one in columns
            if one.startswith("uncertainty_")
        )

    def knows(self, column: str) -> bool:
        """Whether any trial, or any phase of one, tells this."""
        tables = (self.data.trials, self.data.phases)
        return any(column in one and one[column].notna().any() for one in tables)

    def _paired(
        self, rows: pd.DataFrame, other: str, network: str, column: str, keys: list[str]
    ) -> PairedDifference:
        rows = rows[rows["network"] == network].set_index(["participant", *keys])
        first, second = (
            rows.loc[rows["strategy"] == one, column].astype("Float64").dropna()
            for one in (self.data.plan.proposed, other)
        )
        if "phase" not in keys:
            return paired_difference(first, second)
        pairs = paired_difference(*(one.groupby(level=[0, 1]).mean() for one in (first, second)))
        both = (first - second).dropna().groupby(level=[0, 1]).mean()
        found = paired_difference(both, both * 0)
        return PairedDifference(found.estimate, found.p, found.pairs, pairs.unpaired)


def _over_participants(rows: pd.DataFrame, column: str) -> Estimate | None:
    if column not in rows:
        return None
    means = rows.groupby("participant")[column].mean()
    return mean_interval(_floats(means))


def _floats(column: pd.Series) -> list[float]:
    return [float(value) for value in column.dropna()]

"""The numbers that a report asks for, by strategy and network, and what holds by them.

One rule makes the sentences of every comparison.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pandas as pd

from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.report.pages import Estimate, counted, interval, name, p_value
from tams_app.study.results import PHASES, StudyData
from tams_app.study.statistics import (
    MixedModel,
    NotFitted,
    PairedDifference,
    Welch,
    fit_mixed_model,
    mean_interval,
    paired_difference,
    welch,
    wilson_interval,
)
from tams_app.summary.quality import SSIM_KINDS

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

    def count(self, strategy: str, network: str) -> int:
        """How many trials of a condition there are."""
        return len(_select(self.data.trials, "trial", strategy=strategy, network=network))

    def mean(
        self, strategy: str, network: str, column: str, phase: str | None = None
    ) -> Estimate | None:
        """The value of a trial, or of one phase of it: mean and interval over participants."""
        rows = self._rows(phase)
        return _over_participants(rows, column, strategy=strategy, network=network)

    def relied_on(self, phase: str, view: str) -> Estimate | None:
        """A view's share of what the operator's glances show in a phase, over all conditions."""
        return _over_participants(self._rows(phase), f"relied_on_{view}_fraction")

    def values(self, strategy: str, network: str, column: str) -> list[float]:
        """Each trial's value that is there."""
        return _floats(_select(self.data.trials, column, strategy=strategy, network=network))

    def trials_mean(self, strategy: str, network: str, column: str) -> Estimate | None:
        """Mean and interval over trials."""
        return mean_interval(self.values(strategy, network, column))

    def median(self, strategy: str, network: str, column: str) -> float | None:
        """The median over trials."""
        found = self.values(strategy, network, column)
        return float(np.median(found)) if found else None

    def views_mean(self, strategy: str, network: str, column: str) -> float | None:
        """The mean over trials of the mean over the views, of columns such as eih_`column`."""
        where = {"strategy": strategy, "network": network}
        columns = [f"{view}_{column}" for view in self.data.config.video.views]
        views = pd.concat([_select(self.data.trials, one, **where) for one in columns], axis=1)
        means = _floats(views.mean(axis=1))
        return float(np.mean(means)) if means else None

    def share(self, strategy: str, network: str, column: str) -> Estimate | None:
        """The share of trials of which a column of true and false is true."""
        known = self.values(strategy, network, column)
        return wilson_interval(round(sum(known)), len(known))

    def difference(
        self, other: str, network: str, column: str, phase: str | None = None
    ) -> PairedDifference:
        """Proposed minus `other`, on pairs of trials that share everything else, or in a phase."""
        return paired_difference(*self._pair_values(other, network, column, phase))

    def common_phases_difference(self, other: str, network: str) -> PairedDifference:
        """The same of the mean of received SSIM over the phases that both trials of a pair have."""
        values = (self._pair_values(other, network, "received_ssim", one) for one in PHASES)
        differences = pd.concat([(first - second).dropna() for first, second in values])
        means = differences.groupby(level=[0, 1]).mean()
        return paired_difference(means, means * 0.0)

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
        rows = self._rows(phase)
        scored = rows[list(SSIM_KINDS)].notna().any(axis=1)
        return len(self.data.trials) - int(scored.sum())

    @property
    def phases_without_complete_frames(self) -> int:
        """Phases with scored frames of which each was incomplete, in all trials."""
        scored = self.data.phases[list(SSIM_KINDS)].notna().any(axis=1)
        without = self.data.phases[["received_ssim", "undamaged_received_ssim"]].isna().any(axis=1)
        return int((scored & without).sum())

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
        """Whether any trial, or any phase of one, has this."""
        tables = (self.data.trials, self.data.phases)
        return any(column in one and one[column].notna().any() for one in tables)

    def _rows(self, phase: str | None) -> pd.DataFrame:
        """Of the trials, or of one of their phases."""
        phases = self.data.phases
        return self.data.trials if phase is None else phases[phases["phase"] == phase]

    def _pair_values(
        self, other: str, network: str, column: str, phase: str | None
    ) -> tuple[pd.Series, pd.Series]:
        """The proposed strategy's values and the other's, by participant and repetition."""
        by_pair = self._rows(phase).set_index(["participant", "repetition"])
        first, second = (
            _select(by_pair, column, strategy=one, network=network).astype("Float64").dropna()
            for one in (self.data.plan.proposed, other)
        )
        return first, second


def _select(table: pd.DataFrame, column: str, **where: str) -> pd.Series:
    """A column of the rows in which other columns have these values; all missing if unknown."""
    if column not in table:
        return pd.Series(pd.NA, index=table.index, dtype="Float64")
    mask = np.ones(len(table), dtype=bool)
    for key, value in where.items():
        mask &= (table[key] == value).to_numpy(dtype=bool)
    return table.loc[mask, column]


def _over_participants(table: pd.DataFrame, column: str, **where: str) -> Estimate | None:
    values = _select(table.set_index("participant"), column, **where)
    return mean_interval(_floats(values.groupby(level=0).mean()))


def _floats(column: pd.Series) -> list[float]:
    return [float(value) for value in column.dropna()]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A column of the trials that strategies are compared by."""

    title: str
    column: str
    digits: int
    more_is_better: bool = True
    unit: str = ""

    @property
    def better(self) -> str:
        """The direction on an axis."""
        return "better →" if self.more_is_better else "← better"


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, how many comparisons it holds in, and a sentence for each of them."""

    text: str
    tally: str
    sentences: tuple[str, ...]


class TestedClaim(StrEnum):
    """What the test says of a claim."""

    HOLDS = "holds"
    OPPOSITE = "the opposite holds"
    NOT_SHOWN = "no difference shown"
    UNKNOWN = "not known"


def judge(found: PairedDifference, *, more_is_better: bool) -> TestedClaim:
    """Whether the proposed strategy wins, decided by the paired t test alone."""
    if found.estimate is None or found.estimate.low is None:
        return TestedClaim.UNKNOWN
    if not found.is_shown:
        return TestedClaim.NOT_SHOWN
    wins = (found.estimate.value > 0) == more_is_better
    return TestedClaim.HOLDS if wins else TestedClaim.OPPOSITE


def claims(measures: Measures) -> list[Claim]:
    """The paper's three claims."""
    limit_s = measures.data.limit_s
    proposed = name(measures.data.plan.proposed)
    return [
        _claim(measures, f"{proposed} {text}", quantity)
        for text, quantity in zip(
            (
                "gives the higher SSIM of the primary view (received frames)",
                f"shortens the task (times censored at {limit_s:g} s)",
                "raises the success rate (differences as shares)",
            ),
            compared(limit_s),
            strict=True,
        )
    ]


def compared(limit_s: float) -> tuple[Quantity, ...]:
    """What the paper's claims are about."""
    time = f"Time, censored at {limit_s:g} s [s]"
    return (
        Quantity("Received SSIM", "primary_received_ssim", 4),
        Quantity(time, "censored_time_s", 2, more_is_better=False, unit=" s"),
        Quantity("Success [share]", "success_share", 3),
    )


PARTS = (
    Quantity("Received SSIM", "summed_ssim", 4),
    Quantity("Its part by coding", "undamaged_ssim", 4),
    Quantity("Its part by loss", "lost_ssim", 4),
)


def _claim(measures: Measures, text: str, quantity: Quantity) -> Claim:
    plan = measures.data.plan
    found = [
        (other, network, measures.difference(other, network, quantity.column))
        for network in plan.networks
        for other in measures.others
    ]
    findings = Counter(judge(one, more_is_better=quantity.more_is_better) for *_, one in found)
    counts = ", ".join(f"{one.value}: {findings[one]}" for one in TestedClaim if findings[one])
    return Claim(
        text,
        f"{counted(len(found), 'comparison')}: {counts}",
        tuple(
            f"{name(network)}, {name(plan.proposed)} against {name(other)}: "
            f"{difference_sentence(one, quantity)}"
            for other, network, one in found
        ),
    )


def difference_sentence(found: PairedDifference, quantity: Quantity) -> str:
    """The finding with its reason and its numbers, worded alike whichever side it favours."""
    finding = judge(found, more_is_better=quantity.more_is_better)
    if found.estimate is None:
        return f"{finding.value} (there is no pair of trials)."
    if finding is TestedClaim.UNKNOWN:
        why = f"{counted(found.estimate.n, 'participant')}: too few to test"
    else:
        why = f"paired t test, {p_value(found.p or 0.0)}"
    numbers = interval(found.estimate, quantity.digits, signed=True)
    left_out = f", {counted(found.unpaired, 'trial')} without counterpart" if found.unpaired else ""
    pairs = counted(found.pairs, "pair")
    return f"{finding.value} ({why}); difference {numbers}{quantity.unit} over {pairs}{left_out}."

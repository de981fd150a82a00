"""The ablation's figures: means over seeds, paired differences, what each factor moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.experiments.ablation_cells import FACTORS, Cell
from tams_app.report.pages import Estimate
from tams_app.study.statistics import mean_interval

Figures = Mapping[str, float | None]  # of one trial, by measure


@dataclass(frozen=True, slots=True)
class Row:
    """One cell on one network; `against` is its received SSIM minus the product's, seed by seed."""

    network: str
    cell: Cell
    is_product: bool
    means: dict[str, float | None]
    seeds: int
    against: Estimate | None


@dataclass(frozen=True, slots=True)
class FactorRange:
    """What changing one factor alone moves on one network: largest minus smallest cell mean."""

    network: str
    factor: str
    measure: str
    best: str
    worst: str
    range: float


def rows(network: str, product: Cell, trials: Mapping[Cell, Mapping[int, Figures]]) -> list[Row]:
    """One row per cell, in order; `trials` by cell and seed."""
    return [
        Row(
            network,
            cell,
            cell == product,
            _means(list(by_seed.values())),
            len(by_seed),
            None if cell == product else _against(by_seed, trials[product]),
        )
        for cell, by_seed in trials.items()
    ]


def ranges(
    found: Sequence[Row], measures: Sequence[str] = ("received_ssim", "live_ssim")
) -> list[FactorRange]:
    """For each factor, over the product's row and those that differ from it in that alone."""
    product = next(row for row in found if row.is_product)
    told = []
    for factor in FACTORS:
        others = [name for name in FACTORS if name != factor]
        alone = [
            row
            for row in found
            if all(getattr(row.cell, name) == getattr(product.cell, name) for name in others)
        ]
        for measure in measures:
            known = [
                (value, str(getattr(row.cell, factor)))
                for row in alone
                if (value := row.means[measure]) is not None
            ]
            if known:
                (low, worst), (high, best) = min(known), max(known)
                told.append(FactorRange(product.network, factor, measure, best, worst, high - low))
    return told


def _means(trials: Sequence[Figures]) -> dict[str, float | None]:
    """Over the trials that have the measure; None where none has."""
    found: dict[str, float | None] = {}
    for measure in trials[0]:
        known = [value for trial in trials if (value := trial[measure]) is not None]
        found[measure] = float(np.mean(known)) if known else None
    return found


def _against(cell: Mapping[int, Figures], product: Mapping[int, Figures]) -> Estimate | None:
    differences = []
    for seed, figures in cell.items():
        mine, its = figures["received_ssim"], product[seed]["received_ssim"]
        if mine is not None and its is not None:
            differences.append(mine - its)
    return mean_interval(differences)

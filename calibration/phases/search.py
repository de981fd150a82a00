"""The thresholds with which Algorithm 1 agrees best with labelled trials.

Algorithm 1 itself is run, never a copy of it. What makes the search affordable: with the gripper
open it knows T_align only and with it closed T_pre only, and a gripper edge decides by itself; so
one run with both dwell times set to T tells the hits of the open stretches for T_align = T and of
the closed ones for T_pre = T, and hits add up (`tests/calibration/test_phases_search.py` holds it).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import TypeAlias

import numpy as np

from calibration.phases.trials import CODE, Trial, infer
from tams_app.config import PhasesConfig
from tams_app.records import Phase

SPEED_STEP_MM_S = 0.25  # the search's resolution
DWELL_STEP_S = 0.025  # three control periods

# v_ε and v_z^min in SPEED_STEP_MM_S, T_align and T_pre in DWELL_STEP_S
Point: TypeAlias = tuple[int, int, int, int]

# With a dwell time of 0 every motion is ALIGN or PRE_RELEASE: that abolishes a phase.
SMALLEST: Point = (0, 0, 1, 1)
LARGEST: Point = (160, 240, 60, 60)  # 40 mm/s, 60 mm/s, 1.5 s
_V_EPS = (4, 12, 20, 32, 56, 80, 112)
_VZ_MIN = (8, 20, 40, 60, 88, 128)
_DWELLS = (1, 4, 8, 12, 18, 26, 36)
_STARTS = 3  # local searches, from the best points of the grid
_STRIDES = ((8, 8, 4), (4, 4, 2), (2, 2, 1), (1, 1, 1))  # of v_ε, v_z^min and the dwell times
_DWELL_WINDOW = (-1, 0, 1)  # strides; recovers what it is not told as surely as a wider one
_OPEN = np.array([CODE[phase] for phase in (Phase.REACH, Phase.ALIGN, Phase.RELEASE)], np.int8)


def thresholds_at(point: Point, smoothing_ms: float) -> PhasesConfig:
    """A point of the search in the configuration's units."""
    v_eps, vz_min, align, pre = point
    return PhasesConfig(
        v_eps_mm_s=v_eps * SPEED_STEP_MM_S,
        vz_min_mm_s=vz_min * SPEED_STEP_MM_S,
        align_dwell_s=round(align * DWELL_STEP_S, 6),
        pre_release_dwell_s=round(pre * DWELL_STEP_S, 6),
        smoothing_ms=smoothing_ms,
    )


def point_of(thresholds: PhasesConfig) -> Point:
    """The point of the search nearest to `thresholds`."""
    return (
        round(thresholds.v_eps_mm_s / SPEED_STEP_MM_S),
        round(thresholds.vz_min_mm_s / SPEED_STEP_MM_S),
        round(thresholds.align_dwell_s / DWELL_STEP_S),
        round(thresholds.pre_release_dwell_s / DWELL_STEP_S),
    )


DEFAULT_POINT = point_of(PhasesConfig())


# How good a point is: fewer misses first, then nearer to the defaults, then smaller numbers.
_Rank: TypeAlias = tuple[int, float, Point]


class Search:
    """Looks for the best thresholds over any choice of the trials; each run is made once."""

    def __init__(self, trials: Sequence[Trial]) -> None:
        self._trials = trials
        self._hits: dict[tuple[int, int, int, int], tuple[int, int]] = {}

    def hits(self, point: Point, chosen: Sequence[int]) -> int:
        """In how many ticks of the `chosen` trials (by index) Algorithm 1 says the true phase."""
        v_eps, vz_min, align, pre = point
        return sum(
            self._run(trial, v_eps, vz_min, align)[0] + self._run(trial, v_eps, vz_min, pre)[1]
            for trial in chosen
        )

    def best(self, chosen: Sequence[int], progress: Callable[[float], None]) -> Point:
        """The point with the most hits over `chosen`; of equals the nearest to the defaults.

        A coarse grid, then from its best points downhill with shrinking strides. Nothing of the
        trials that are not chosen is looked at. `progress` is told the part of the grid done.
        """
        starts = sorted(self._grid(chosen, progress))[:_STARTS]
        return min(self._descend(start, chosen) for start in starts)[2]

    def _grid(self, chosen: Sequence[int], progress: Callable[[float], None]) -> Iterator[_Rank]:
        """For each pair of speeds of the grid the best dwell times; the defaults besides."""
        yield self._rank(DEFAULT_POINT, chosen)
        pairs = list(product(_V_EPS, _VZ_MIN))
        for done, (v_eps, vz_min) in enumerate(pairs, start=1):
            yield self._with_best_dwells(v_eps, vz_min, _DWELLS, _DWELLS, chosen)
            progress(done / len(pairs))

    def _descend(self, start: _Rank, chosen: Sequence[int]) -> _Rank:
        """From `start` to the best neighbour, and so on, until none is better at any stride."""
        best = start
        for stride in _STRIDES:
            while (nearby := self._best_near(best[2], stride, chosen)) < best:
                best = nearby
        return best

    def _best_near(
        self, point: Point, stride: tuple[int, int, int], chosen: Sequence[int]
    ) -> _Rank:
        """The best point within one stride."""
        v_eps, vz_min, align, pre = point
        aligns, pres = _window(align, stride[2]), _window(pre, stride[2])
        return min(
            self._with_best_dwells(v_eps + a, vz_min + b, aligns, pres, chosen)
            for a, b in product((-stride[0], 0, stride[0]), (-stride[1], 0, stride[1]))
            if SMALLEST[0] <= v_eps + a <= LARGEST[0] and SMALLEST[1] <= vz_min + b <= LARGEST[1]
        )

    def _with_best_dwells(
        self,
        v_eps: int,
        vz_min: int,
        aligns: Sequence[int],
        pres: Sequence[int],
        chosen: Sequence[int],
    ) -> _Rank:
        """The best T_align does not depend on T_pre, nor the other way round."""
        align = min(self._rank((v_eps, vz_min, align, pres[0]), chosen) for align in aligns)
        best = align[2][2]
        return min(self._rank((v_eps, vz_min, best, pre), chosen) for pre in pres)

    def _rank(self, point: Point, chosen: Sequence[int]) -> _Rank:
        apart = sum((a - b) ** 2 / b**2 for a, b in zip(point, DEFAULT_POINT, strict=True))
        return -self.hits(point, chosen), apart, point

    def _run(self, trial: int, v_eps: int, vz_min: int, dwell: int) -> tuple[int, int]:
        """Hits with the gripper open and with it closed, both dwell times being `dwell`."""
        key = (trial, v_eps, vz_min, dwell)
        if key not in self._hits:
            labelled = self._trials[trial]
            # the smoothing is in the speeds already
            inferred = infer(labelled.motion, thresholds_at((v_eps, vz_min, dwell, dwell), 100.0))
            right = inferred == labelled.labels
            is_open = np.isin(inferred, _OPEN)
            self._hits[key] = (
                int(np.count_nonzero(right & is_open)),
                int(np.count_nonzero(right & ~is_open)),
            )
        return self._hits[key]


def _window(dwell: int, stride: int) -> list[int]:
    """The dwell times around one, within the range."""
    around = (dwell + step * stride for step in _DWELL_WINDOW)
    return [value for value in around if SMALLEST[2] <= value <= LARGEST[2]]

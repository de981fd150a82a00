"""Whether two columns of figures agree: means over seeds, differences, verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RATE_LIMIT = 0.05  # of the live rate
SSIM_LIMIT = 0.01


@dataclass(frozen=True, slots=True)
class Agreement:
    """One measure of one view, live and virtual: means over the seeds where both have it.

    `difference` is live minus virtual, relative to live where the limit is a share of it;
    `spread` its standard deviation over seeds, None with fewer than two. `limit` None: for
    information only.
    """

    view: str
    measure: str
    live: float | None
    virtual: float | None
    difference: float | None
    spread: float | None
    seeds: int
    limit: float | None

    @property
    def verdict(self) -> str:
        """met, missed, not measured; "" where nothing was promised."""
        if self.limit is None:
            return ""
        if self.difference is None:
            return "not measured"
        return "met" if abs(self.difference) <= self.limit else "missed"


def compare(
    view: str,
    measure: str,
    pairs: Sequence[tuple[float | None, float | None]],
    limit: float | None = None,
    relative: bool = False,
) -> Agreement:
    """`pairs`: live and virtual of each seed; a seed without either does not count."""
    known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64).reshape(-1, 2)
    if not len(known):
        return Agreement(view, measure, None, None, None, None, 0, limit)
    live, virtual = np.mean(known, axis=0)
    apart = known[:, 0] - known[:, 1]
    if relative:
        if live == 0:
            return Agreement(view, measure, 0.0, float(virtual), None, None, len(known), limit)
        apart = apart / live  # so that the mean of the seeds is that of the means
    spread = float(np.std(apart, ddof=1)) if len(known) > 1 else None
    return Agreement(
        view,
        measure,
        float(live),
        float(virtual),
        float(np.mean(apart)),
        spread,
        len(known),
        limit,
    )


def overall(rows: Sequence[Agreement]) -> str:
    """met where every promise is; missed where one is; else not measured."""
    verdicts = {row.verdict for row in rows} - {""}
    if "missed" in verdicts:
        return "missed"
    return "met" if verdicts == {"met"} else "not measured"

"""The paper's rule to share a budget among views."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache


def allocate(weights: Mapping[str, float], budget_kbps: float, floor_kbps: float) -> dict[str, int]:
    """Target bitrates by the allocation rule (paper, section III-D, equations 4 and 5).

    b_v = b_min + w_v (B - V b_min) for B >= V b_min, else b_v = B / V. The arithmetic is exact on
    the decimal weights: 0.23 + 0.50 + 0.27 is 1, not almost 1.

    Args:
        weights: w_v, one non-negative share per view; divided by their sum, which must not be 0.
        budget_kbps: B_t, what all views may use together [kbit/s]; a negative one counts as 0.
        floor_kbps: b_min, the least that each view gets while the budget allows it [kbit/s].

    Returns:
        The target of each view in whole kbit/s, rounded down: the sum never exceeds the budget, and
        no target decreases when the budget grows.

    Raises:
        OverflowError: the budget is infinite.
    """
    return dict(_allocated(tuple(weights.items()), budget_kbps, floor_kbps))


@lru_cache(maxsize=8)  # asked 20 times a second, and most often the same
def _allocated(
    weights: tuple[tuple[str, float], ...], budget_kbps: float, floor_kbps: float
) -> dict[str, int]:
    budget = Fraction(max(0.0, budget_kbps))
    floor = Fraction(floor_kbps)
    shares = {view: Fraction(str(weight)) for view, weight in weights}
    spare = budget - len(shares) * floor
    if spare < 0:
        return dict.fromkeys(shares, int(budget / len(shares)))
    total = sum(shares.values())
    return {view: int(floor + share / total * spare) for view, share in shares.items()}

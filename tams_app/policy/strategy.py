"""What a strategy is: from phase and budget to a target for each view."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache

from tams_app.config import PolicyConfig
from tams_app.records import Phase


class Strategy:
    """The rule that shares the budget among the views: a share for each, in each phase.

    An own one is a subclass with `weights`, entered in `STRATEGIES` (policy/allocation.py) under
    the name that the configuration's `strategy` then accepts. One with another rule than
    `allocate` overrides `targets`.
    """

    source_drop_below_kbps = 80.0  # a frame of 30 a second then has 330 bytes: less shows nothing
    """Target [kbit/s] below which whole frames are left out, so that each keeps the bits that it
    has at this target and 30 frames a second."""

    def __init__(self, policy: PolicyConfig) -> None:
        """Take over the policy and its floor.

        Args:
            policy: `policy` of the configuration.
        """
        self.policy = policy
        self.floor_kbps = policy.allocation.floor_kbps

    def weights(self, phase: Phase) -> Mapping[str, float]:
        """The shares in `phase`: W_{p,v} of the paper's section III-C.

        Args:
            phase: the phase that was inferred last; while a view is pinned, one whose view it is.

        Returns:
            One non-negative share for each configured view; they sum to 1 (paper, equation 2).
        """
        raise NotImplementedError

    def targets(self, phase: Phase, budget_kbps: float) -> dict[str, int]:
        """Share the budget; called about 20 times a second and at each new phase.

        Args:
            phase: as of `weights`.
            budget_kbps: B_t, what all views may use together [kbit/s of IP datagram bytes].

        Returns:
            The target of each configured view, in whole kbit/s; their sum never exceeds the budget.
        """
        return allocate(self.weights(phase), budget_kbps, self.floor_kbps)


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

"""Estimates of the uplink's capacity, before the safety factor: one module for each mode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.config import PolicyConfig
from tams_app.policy.budget.feedback import FeedbackBudget
from tams_app.policy.budget.oracle import OracleBudget
from tams_app.policy.budget.sender import SenderBudget
from tams_app.records import Phase, UplinkReport


class Budget(Protocol):
    """A source of capacity estimates; `observe` is called before each of the questions.

    A new one is a class entered in `BUDGETS` under its name, which `BudgetConfig.mode` must list.
    """

    def observe(self, report: UplinkReport) -> None:
        """Take in what the senders know; the time of `report` never decreases."""

    def capacity_kbps(self, now_ns: int) -> float:
        """The capacity that the uplink is believed to have at `now_ns`.

        Args:
            now_ns: the time [ns] of the last `observe`.

        Returns:
            The estimate [kbit/s of IP datagram bytes], finite and not negative. The policy
            multiplies it with the safety factor (0.92 in the paper, section IV-C).
        """

    def padding_bytes(self, now_ns: int) -> int:
        """Bytes of padding [IP datagrams] to send at once as a probe, asked for once each."""

    def flight_limit_bytes(self, now_ns: int) -> float:
        """How many bytes may be under way without having been reported; infinite: any number."""


def _feedback(policy: PolicyConfig, _capacity: Capacity) -> Budget:
    views = len(policy.weights.matrix[Phase.REACH])
    return FeedbackBudget(policy.budget, views * policy.allocation.floor_kbps)


BUDGETS: dict[str, Callable[[PolicyConfig, Capacity], Budget]] = {
    "oracle": lambda policy, capacity: OracleBudget(capacity, policy.budget),
    "sender": lambda policy, _capacity: SenderBudget(policy.budget),
    "feedback": _feedback,
}


def make_budget(policy: PolicyConfig, capacity: Capacity) -> Budget:
    """The budget of `policy.budget.mode`; `capacity` is what the oracle knows."""
    return BUDGETS[policy.budget.mode](policy, capacity)

"""Estimates of the uplink's capacity, before the safety factor: one module for each mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.config import PolicyConfig
from tams_app.policy.budget.feedback import FeedbackBudget
from tams_app.policy.budget.oracle import OracleBudget
from tams_app.policy.budget.sender import SenderBudget
from tams_app.records import Phase, UplinkReport
from tams_app.registry import Registry


class Budget(Protocol):
    """A source of capacity estimates; `observe` is called before each of the questions.

    A new one is a `BudgetKind` entered in `BUDGETS`, or an entry point of `tams.budgets`.
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


@dataclass(frozen=True, slots=True)
class BudgetKind:
    """A way to know the capacity.

    make: of the policy's configuration and the emulated link's capacity, which only a budget that
        looks at nothing else (an oracle) may use.
    hears_reports: receivers' RTCP reports reach it. hears_packets: receivers report each packet,
        too, so that it may pad and bound what is under way.
    """

    make: Callable[[PolicyConfig, Capacity], Budget]
    hears_reports: bool = True
    hears_packets: bool = False


def _feedback(policy: PolicyConfig, _capacity: Capacity) -> Budget:
    views = len(policy.weights.matrix[Phase.REACH])
    return FeedbackBudget(policy.budget, views * policy.allocation.floor_kbps)


BUDGETS: Registry[BudgetKind] = Registry(
    "policy.budget.mode",
    "tams.budgets",
    {
        "oracle": BudgetKind(
            lambda policy, capacity: OracleBudget(capacity, policy.budget), hears_reports=False
        ),
        "sender": BudgetKind(lambda policy, _capacity: SenderBudget(policy.budget)),
        "feedback": BudgetKind(_feedback, hears_packets=True),
    },
)


def make_budget(policy: PolicyConfig, capacity: Capacity) -> Budget:
    """The budget of `policy.budget.mode`; `capacity` is what the oracle knows.

    Raises:
        ConfigError: there is no such mode.
    """
    return BUDGETS[policy.budget.mode].make(policy, capacity)

"""Estimates of the uplink's capacity, before the safety factor: one for each mode."""

from __future__ import annotations

import math

from tams_app.capacity import Capacity
from tams_app.config import PolicyConfig
from tams_app.records import UplinkReport
from tams_app.registry import Registry
from tams_app.units import NS_PER_MS

_TRACE_WINDOW_NS = 100 * NS_PER_MS  # two steps of the policy loop


class Budget:
    """A source of capacity estimates; `observe` comes before `capacity_kbps` and the flight limit.

    This one observes nothing, pads nothing and limits nothing: a new one is a subclass with
    `capacity_kbps` and what else it does, entered in `BUDGETS`, or an entry point of
    `tams.budgets`.
    """

    receives_reports = True
    """It receives the receivers' RTCP reports."""
    receives_packets = False
    """It also receives the fate of each packet, and may pad and bound what is under way."""

    def __init__(self, policy: PolicyConfig, capacity: Capacity) -> None:
        """Make it of the policy's configuration.

        Args:
            policy: `policy` of the configuration.
            capacity: the emulated link's, which only a budget that looks at nothing else (an
                oracle) may use.
        """

    def observe(self, report: UplinkReport) -> None:
        """Take in what the senders know, at each step of the policy (about 20 times a second).

        Args:
            report: bytes sent, arrivals and receptions since the report before, as far as
                it receives them; its time never decreases.
        """

    def capacity_kbps(self, now_ns: int) -> float:
        """The capacity that the uplink is believed to have at `now_ns`.

        Args:
            now_ns: the time [ns] of the last `observe`.

        Returns:
            The estimate [kbit/s of IP datagram bytes], finite and not negative. The policy
            multiplies it with the safety factor (0.92 in the paper, section IV-C).
        """
        raise NotImplementedError

    def padding_bytes(self, now_ns: int) -> int:
        """Padding to send at once as a probe; called between steps too, if `receives_packets`.

        Args:
            now_ns: the time [ns]; never decreases.

        Returns:
            Bytes of IP datagrams, sent once for each call; 0: none.
        """
        return 0

    def flight_limit_bytes(self, now_ns: int) -> float:
        """The limit of bytes under way that have not been reported; beyond it frames are left out.

        Args:
            now_ns: the time [ns] of the last `observe`.

        Returns:
            Bytes of IP datagrams; infinite: no limit.
        """
        return math.inf


class OracleBudget(Budget):
    """The emulated link's own rate, of a trace the mean of its last window, without look-ahead.

    The reference for experiments.
    """

    receives_reports = False

    def __init__(self, policy: PolicyConfig, capacity: Capacity) -> None:
        super().__init__(policy, capacity)
        self._capacity = capacity
        self._max_kbps = policy.budget.max_kbps

    def capacity_kbps(self, now_ns: int) -> float:
        return min(self._max_kbps, self._capacity.mean_kbps(now_ns - _TRACE_WINDOW_NS, now_ns))


BUDGETS: Registry[type[Budget]] = Registry(
    "policy.budget.mode",
    "tams.budgets",
    {
        "oracle": OracleBudget,
        "sender": "tams_app.policy.budget.sender:SenderBudget",
        "feedback": "tams_app.policy.budget.feedback:FeedbackBudget",
    },
)
"""The budgets by their word for `policy.budget.mode`; entry points of `tams.budgets`."""

"""The policy with what stands around it: what it must learn first, and who hears of its targets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.config import Config
from tams_app.records import Allocation, Phase
from tams_app.runtime.clock import Clock
from tams_app.session import build
from tams_app.session.policy_loop import PolicyLoop
from tams_app.session.recorders import SessionRecords


class Sending(Protocol):
    """The senders of all views."""

    def set_targets(self, target_kbps: dict[str, int]) -> None:
        """The wire rate each view is to meet from now on."""

    def wire_bytes(self) -> int:
        """IP datagram bytes sent so far, all views together."""


class Allocating:
    """Turns phases into targets of the senders, and keeps both the targets and the capacity."""

    def __init__(self, config: Config, capacity: Capacity, records: SessionRecords) -> None:
        self._config = config
        self._capacity = capacity
        self._records = records
        self._policy, self._sender_budget = build.policy(config, capacity)

    def start_kbps(self, now_ns: int) -> dict[str, int]:
        """Targets to begin with."""
        return self._policy.step(now_ns, Phase.REACH).target_kbps

    def loop(
        self, clock: Clock, sending: Sending, allocated: Callable[[Allocation], None] | None = None
    ) -> PolicyLoop:
        """The loop that keeps `sending` at its targets; `allocated` hears of each, too."""

        def before_step(now_ns: int) -> None:
            if self._sender_budget is not None:
                self._sender_budget.observe(now_ns, sending.wire_bytes())
            self._records.capacity(now_ns, self._capacity)

        def apply(allocation: Allocation) -> None:
            sending.set_targets(allocation.target_kbps)
            self._records.record(allocation)
            if allocated is not None:
                allocated(allocation)

        rate_hz = self._config.policy.rate_hz
        return PolicyLoop(clock, rate_hz, self._policy, before_step, apply)

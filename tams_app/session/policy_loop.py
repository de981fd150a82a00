"""The policy thread: 20 Hz, and at once when a phase begins."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tams_app.clock import NS_PER_S, Clock
from tams_app.policy.engine import Policy
from tams_app.records import Allocation, Phase


class PolicyLoop:
    """Turns the newest phase into bitrate targets; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        rate_hz: float,
        policy: Policy,
        before_step: Callable[[int], None],
        apply: Callable[[Allocation], None],
    ) -> None:
        self._clock = clock
        self._period_s = 1.0 / rate_hz
        self._policy = policy
        self._before_step = before_step
        self._apply = apply
        self._phase = Phase.REACH
        self._woken = threading.Event()

    def enter(self, phase: Phase) -> None:
        """A phase began: step at once. Called by the control thread; does not block."""
        self._phase = phase
        self._woken.set()

    def run(self, stop: threading.Event) -> None:
        due_ns = self._clock.now_ns()
        while not stop.is_set():
            self.step()
            due_ns = max(due_ns + round(self._period_s * NS_PER_S), self._clock.now_ns())
            remaining_s = (due_ns - self._clock.now_ns()) / NS_PER_S
            if self._woken.wait(remaining_s):
                self._woken.clear()
                due_ns = self._clock.now_ns()

    def step(self) -> None:
        """One allocation for the newest phase."""
        now_ns = self._clock.now_ns()
        self._before_step(now_ns)
        self._apply(self._policy.step(now_ns, self._phase))

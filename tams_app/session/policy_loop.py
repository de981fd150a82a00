"""The policy thread: 20 Hz, and at once when a phase begins."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tams_app.policy.engine import Policy
from tams_app.records import Allocation, Phase
from tams_app.runtime.clock import NS_PER_S, Clock


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
        self._period_ns = round(NS_PER_S / rate_hz)
        self.due_ns = clock.now_ns()  # of the next step, unless a phase begins before
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
        self.due_ns = self._clock.now_ns()
        while not stop.is_set():
            self.step_if_due()
            self._woken.wait((self.due_ns - self._clock.now_ns()) / NS_PER_S)

    def step_if_due(self) -> None:
        """One allocation, if its time has come or a phase has begun since the last."""
        now_ns = self._clock.now_ns()
        if self._woken.is_set():
            self._woken.clear()
            self.due_ns = now_ns
        if now_ns < self.due_ns:
            return
        self.due_ns = max(self.due_ns + self._period_ns, now_ns)
        self._before_step(now_ns)
        self._apply(self._policy.step(now_ns, self._phase))

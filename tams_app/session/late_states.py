"""The arm's states as an operator's side at the far end of the emulated network receives them."""

from __future__ import annotations

import threading
from collections import deque

from tams_app.config import Network
from tams_app.prediction.forward_model import ArmHeard
from tams_app.prediction.present import Present
from tams_app.records import Record, Tick
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS

RATE_HZ = 120.0


class LateStates(Listener):
    """Tells `present` of each sample at once, and of the state as late as the network makes it.

    Where both sides are one process the hand moves the arm without delay. What is shown of it is
    corrected by what the operator's computer would know, with the whole of the jitter.
    """

    def __init__(self, present: Present, network: Network, at_once: bool = False) -> None:
        """`at_once`: with each tick; else `run`, or `step`, takes in what came since."""
        self._present, self._at_once = present, at_once
        self._delay_ns = round((network.latency_ms + network.jitter_ms) * NS_PER_MS)
        self._ticks: deque[Tick] = deque()
        self._coming: deque[tuple[int, ArmHeard, bool]] = deque()

    def receive(self, record: Record) -> None:
        """In the control thread, which `step` must not hold up."""
        if isinstance(record, Tick):
            self._ticks.append(record)
            if self._at_once:
                self.step()

    def run(self, stop: threading.Event, clock: Clock) -> None:
        """A thread's body: what came since, 120 times a second."""
        rate = FixedRate(clock, RATE_HZ)
        while not stop.is_set():
            rate.wait()
            self.step()

    def step(self) -> None:
        """Take in the ticks that are over; in one thread."""
        while self._ticks:
            self._take(self._ticks.popleft())

    def _take(self, tick: Tick) -> None:
        now_ns = tick.started_ns
        self._present.sent(tick.controller, now_ns)
        if tick.arm is not None:
            state = ArmHeard(
                t_ns=tick.arm.received_ns,
                joints=tick.arm.joints,
                until_ns=now_ns,
                arming=ArmingState(tick.arming),
                orientation_mode=tick.orientation_mode,
                speed_scale=tick.speed_scale,
            )
            closed = bool(tick.arm.gripper_closed)
            self._coming.append((now_ns + self._delay_ns, state, closed))
        while self._coming and self._coming[0][0] <= now_ns:
            _, state, closed = self._coming.popleft()
            self._present.heard(state, way_ns=0, closed=closed)

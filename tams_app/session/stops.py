"""How long the arm took to stand still after something stopped it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tams_app.records import ArmState, StopRecord
from tams_app.runtime.clock import NS_PER_S
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason

STANDING_M_S = 0.001
_MIN_INTERVAL_S = 0.002

_STOPPING = (ArmingState.HOLDING, ArmingState.FAULT)


class StopWatch:
    """Watches ticks; hands out one `StopRecord` for each stop that was not the operator's own."""

    def __init__(self, record: Callable[[StopRecord], None]) -> None:
        self._record = record
        self._before = ArmingState.DISARMED
        self._reason: Reason | None = None
        self._visible_ns = 0
        self._last: ArmState | None = None

    def observe(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        """Take in one tick."""
        speed = self._reported_speed(arm)
        began = output.arming in _STOPPING and self._before not in _STOPPING
        self._before = output.arming
        if began and output.reason is not None:
            self.finish()
            self._reason, self._visible_ns = output.reason, now_ns
            return
        standing = speed is not None and speed < STANDING_M_S
        if self._reason is not None and standing and arm and arm.received_ns > self._visible_ns:
            self._record(StopRecord(self._reason.label, self._visible_ns, arm.received_ns))
            self._reason = None

    def finish(self) -> None:
        """Record a stop whose end nobody saw."""
        if self._reason is not None:
            self._record(StopRecord(self._reason.label, self._visible_ns, None))
            self._reason = None

    def _reported_speed(self, arm: ArmState | None) -> float | None:
        """TCP speed [m/s] between this report and the last one; None without a new one."""
        last = self._last
        if arm is None or last is None:
            self._last = arm
            return None
        interval_s = (arm.received_ns - last.received_ns) / NS_PER_S
        if interval_s < _MIN_INTERVAL_S:
            return None
        self._last = arm
        return float(np.linalg.norm(arm.tcp.position - last.tcp.position)) / interval_s

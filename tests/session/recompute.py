"""What today's code makes of a session that was recorded, compared with its log.

The inputs are: hand, arm, command link, age of the video and signals of each tick; of each step of
the policy the reports of the receivers, or with budget `oracle` the capacity. Padding is left out:
no allocation follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import Config
from tams_app.policy.allocation import Policy
from tams_app.policy.budget import BUDGETS
from tams_app.policy.inference import INFERENCES
from tams_app.recording import SessionLog
from tams_app.records import Allocation, Tick, UplinkReport
from tams_app.robot import build
from tams_app.robot.control import tick_of
from tams_app.robot.engine import VIDEO_DELAY_FACT
from tams_app.teleop.records import TeleopInput
from tams_app.teleop.safety import Reason

_REASONS = {reason.label: reason for reason in Reason}
# What is read off a record, and by how much it may differ (0: not at all).
OF_TICKS: dict[str, tuple[Callable[[Tick], Any], float]] = {
    "arming": (lambda tick: tick.arming, 0.0),
    "reason": (lambda tick: tick.reason, 0.0),
    "deadman": (lambda tick: tick.deadman, 0.0),
    "orientation mode": (lambda tick: tick.orientation_mode, 0.0),
    "command: stop": (lambda tick: tick.stop, 0.0),
    "command: gripper": (lambda tick: tick.gripper, 0.0),
    "command: velocity": (lambda tick: tuple(tick.twist.linear), 1e-6),
    "command: angular velocity": (lambda tick: tuple(tick.twist.angular), 1e-6),
    "speed scale": (lambda tick: (tick.speed_scale,), 1e-6),
    "phase": (lambda tick: tick.phase, 0.0),
    "smoothed speed": (lambda tick: (tick.speed, tick.vertical_speed), 1e-6),
}
OF_ALLOCATIONS: dict[str, tuple[Callable[[Allocation], Any], float]] = {
    "capacity": (lambda one: (one.capacity_kbps,), 0.01),
    "budget": (lambda one: (one.budget_kbps,), 0.01),
    "targets": (lambda one: tuple(one.target_kbps.values()), 1.0),
}


@dataclass(slots=True)
class Comparison:
    """One quantity of many records: how many were compared, and when they differed [ns]."""

    compared: int
    differing_ns: list[int]


def recompute(log: SessionLog, config: Config) -> dict[str, Comparison]:
    """All ticks and allocations of `log`, whose configuration is `config`, by quantity."""
    return _compared(OF_TICKS, _computed_ticks(log, config)) | _compared(
        OF_ALLOCATIONS, _computed_allocations(log, config)
    )


def _compared(
    quantities: dict[str, tuple[Callable[[Any], Any], float]],
    records: Iterator[tuple[int, Any, Any]],
) -> dict[str, Comparison]:
    found = {name: Comparison(0, []) for name in quantities}
    for t_ns, logged, computed in records:
        for name, (of, tolerance) in quantities.items():
            found[name].compared += 1
            if not _same(of(logged), of(computed), tolerance):
                found[name].differing_ns.append(t_ns)
    return found


def _same(logged: Any, computed: Any, tolerance: float) -> bool:
    if not tolerance:
        return bool(logged == computed)
    return len(logged) == len(computed) and all(
        one == now or abs(one - now) <= tolerance or (math.isnan(one) and math.isnan(now))
        for one, now in zip(logged, computed, strict=True)
    )


def _computed_ticks(log: SessionLog, config: Config) -> Iterator[tuple[int, Tick, Tick]]:
    teleop = build.teleop(config, int(log.facts[VIDEO_DELAY_FACT]))
    phases = INFERENCES[config.policy.phases.inference](config.policy.phases)
    for tick in log.ticks:
        inputs = tick.inputs
        assert inputs is not None
        told = TeleopInput(
            now_ns=tick.started_ns,
            sample=tick.controller,
            arm=tick.arm,
            link=tick.link,
            arm_ready=inputs.arm_ready,
            video_age_ns=inputs.video_age_ns,
            confirm=inputs.confirm,
            estop=inputs.estop,
            faults=tuple(_REASONS[fault] for fault in inputs.faults),
            video_damaged=inputs.video_damaged,
        )
        output = teleop.step(told)
        phases.step(tick.started_ns, tick.arm)
        now = tick_of(told, output, phases, tick.due_ns, tick.finished_ns, tick.skipped)
        yield tick.started_ns, tick, now


def _computed_allocations(
    log: SessionLog, config: Config
) -> Iterator[tuple[int, Allocation, Allocation]]:
    """Estimated from the receivers' reports, or shared out of the capacity that was reported."""
    if BUDGETS[config.policy.budget.mode].receives_reports:
        policy = Policy.of(config, UnlimitedCapacity())
        for logged, inputs in zip(log.allocations, log.policy_inputs, strict=True):
            yield logged.t_ns, logged, policy.step(logged.phase, inputs.report())
        return
    reported: Any = SimpleNamespace()
    reported.mean_kbps = lambda _start_ns, _end_ns: reported.kbps
    policy = Policy.of(config, reported)
    for logged in log.allocations:
        reported.kbps = logged.capacity_kbps
        yield logged.t_ns, logged, policy.step(logged.phase, UplinkReport(logged.t_ns, 0))

"""Feeds what a session received through today's code, and compares what comes out with its log.

The inputs are: hand, arm, command link, age of the video and signals of each tick; of each step of
the policy the reports of the receivers, or with budget `oracle` the capacity. Padding is left out:
no allocation follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import Config
from tams_app.errors import UnreadableLogError
from tams_app.policy.allocation import Policy, make_strategy
from tams_app.policy.budget import BUDGETS
from tams_app.policy.inference import make_inference
from tams_app.recording import SessionLog
from tams_app.records import Allocation, Tick, TickInputs, UplinkReport
from tams_app.robot import build
from tams_app.robot.control import tick_of
from tams_app.robot.engine import VIDEO_DELAY_FACT
from tams_app.teleop.records import TeleopInput
from tams_app.teleop.safety import Reason
from tams_app.units import NS_PER_S

Value = str | bool | None | tuple[float, ...]

_REASONS = {reason.label: reason for reason in Reason}


@dataclass(slots=True)
class Comparison:
    """One quantity of many records, as logged and as computed now."""

    name: str
    unit: str  # "": no number, so that it must be the same
    tolerance: float
    compared: int = 0
    largest: float = 0.0  # difference; infinite where the values are not numbers of the same shape
    differing: int = 0  # by more than the tolerance
    first_ns: int | None = None  # when the first of them was logged

    def take(self, t_ns: int, logged: Value, computed: Value) -> None:
        """Compare one value of each."""
        difference = _difference(logged, computed)
        self.compared += 1
        self.largest = max(self.largest, difference)
        if difference > self.tolerance:
            self.differing += 1
            self.first_ns = t_ns if self.first_ns is None else self.first_ns


@dataclass(frozen=True, slots=True)
class Quantity:
    """Something that can be read off a record."""

    name: str
    of: Callable[[Any], Value]
    unit: str = ""
    tolerance: float = 0.0


OF_TICKS = (
    Quantity("arming", lambda tick: tick.arming),
    Quantity("reason", lambda tick: tick.reason),
    Quantity("deadman", lambda tick: tick.deadman),
    Quantity("orientation mode", lambda tick: tick.orientation_mode),
    Quantity("command: stop", lambda tick: tick.stop),
    Quantity("command: gripper", lambda tick: tick.gripper),
    Quantity("command: velocity", lambda tick: tuple(tick.twist.linear), "m/s", 1e-6),
    Quantity("command: angular velocity", lambda tick: tuple(tick.twist.angular), "rad/s", 1e-6),
    Quantity("speed scale", lambda tick: (tick.speed_scale,), "1", 1e-6),
    Quantity("phase", lambda tick: tick.phase),
    Quantity("smoothed speed", lambda tick: (tick.speed, tick.vertical_speed), "m/s", 1e-6),
)
OF_ALLOCATIONS = (
    Quantity("capacity", lambda one: (one.capacity_kbps,), "kbit/s", 0.01),
    Quantity("budget", lambda one: (one.budget_kbps,), "kbit/s", 0.01),
    Quantity("targets", lambda one: tuple(one.target_kbps.values()), "kbit/s", 1.0),
)


@dataclass(slots=True)
class Recomputed:
    """`until_ns`: after it not all ticks and steps of the policy are compared: some are missing."""

    comparisons: list[Comparison] = field(default_factory=list)
    until_ns: int | None = None

    @property
    def same(self) -> bool:
        """True if nothing differs by more than its tolerance."""
        return not any(one.differing for one in self.comparisons)


def recompute(log: SessionLog, config: Config) -> Recomputed:
    """Compare all ticks and allocations of `log`, whose configuration is `config`.

    UnreadableLogError if it does not have their inputs.
    """
    if not log.ticks:
        raise UnreadableLogError("this log has no ticks of a control loop; give one that has")
    delay = log.facts.get(VIDEO_DELAY_FACT)
    if delay is None or any(tick.inputs is None for tick in log.ticks):
        raise UnreadableLogError(
            f"this log of TAMS {log.header.version} (schema {log.header.schema}) does not say all "
            "that its control loop was told; give one that was recorded with schema 4 or newer"
        )
    found = Recomputed()
    whole = _without_gap(log.ticks, log.header.control_rate_hz)
    if len(whole) < len(log.ticks):
        found.until_ns = whole[-1].started_ns
    ticks = zip(whole, _computed_ticks(whole, config, int(delay)), strict=True)
    found.comparisons += _compared(OF_TICKS, ((one.started_ns, one, now) for one, now in ticks))
    if BUDGETS[config.policy.budget.mode].receives_reports:
        allocations = _estimated_anew(log, config)
    else:
        allocations = _shared_anew(log.allocations, config)
    steps = [
        (one.t_ns, one, now)
        for one, now in allocations
        if found.until_ns is None or one.t_ns <= found.until_ns
    ]
    found.comparisons += _compared(OF_ALLOCATIONS, iter(steps))
    if found.until_ns is None and len(steps) < len(log.allocations):
        found.until_ns = steps[-1][0] if steps else log.header.started_ns
    return found


def _without_gap(ticks: Sequence[Tick], rate_hz: float) -> Sequence[Tick]:
    """The ticks before the first one that the log lacks."""
    period_ns = NS_PER_S / rate_hz
    for number, (before, after) in enumerate(pairwise(ticks), start=1):
        periods = 1 + after.skipped - before.skipped
        if abs(after.due_ns - before.due_ns - periods * period_ns) > period_ns / 2:
            return ticks[:number]
    return ticks


def _computed_ticks(ticks: Sequence[Tick], config: Config, delay_ns: int) -> Iterator[Tick]:
    teleop = build.teleop(config, delay_ns)
    phases = make_inference(config.policy.phases)
    for tick in ticks:
        assert tick.inputs is not None
        told = _told(tick, tick.inputs)
        output = teleop.step(told)
        phases.step(tick.started_ns, tick.arm)
        yield tick_of(told, output, phases, tick.due_ns, tick.finished_ns, tick.skipped)


def _told(tick: Tick, inputs: TickInputs) -> TeleopInput:
    unknown = [fault for fault in inputs.faults if fault not in _REASONS]
    if unknown:
        raise UnreadableLogError(f"this log has a fault that TAMS no longer has: {unknown[0]}")
    return TeleopInput(
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


def _shared_anew(
    allocations: Sequence[Allocation], config: Config
) -> Iterator[tuple[Allocation, Allocation]]:
    """Budget and targets from the capacity as it was reported."""
    budget = _ReportedCapacity()
    policy = Policy(make_strategy(config.strategy, config.policy), budget, config.policy)
    for logged in allocations:
        budget.kbps = logged.capacity_kbps
        yield logged, policy.step(logged.phase, UplinkReport(logged.t_ns, 0))


def _estimated_anew(log: SessionLog, config: Config) -> Iterator[tuple[Allocation, Allocation]]:
    """Capacity, budget and targets from receivers' reports, as long as none of it is missing."""
    policy = Policy.of(config, UnlimitedCapacity())
    for logged, inputs in zip(log.allocations, log.policy_inputs, strict=False):
        if logged.t_ns != inputs.t_ns:
            return
        yield logged, policy.step(logged.phase, inputs.report())


class _ReportedCapacity:
    """A budget that is given the capacity."""

    kbps = 0.0

    def observe(self, report: UplinkReport) -> None:
        """Nothing is estimated."""

    def capacity_kbps(self, now_ns: int) -> float:
        return self.kbps

    def padding_bytes(self, now_ns: int) -> int:
        return 0

    def flight_limit_bytes(self, now_ns: int) -> float:
        return math.inf


def _compared(
    quantities: Sequence[Quantity], records: Iterator[tuple[int, Any, Any]]
) -> list[Comparison]:
    found = [Comparison(one.name, one.unit, one.tolerance) for one in quantities]
    for t_ns, logged, computed in records:
        for quantity, comparison in zip(quantities, found, strict=True):
            comparison.take(t_ns, quantity.of(logged), quantity.of(computed))
    return found


def _difference(logged: Value, computed: Value) -> float:
    if isinstance(logged, tuple) and isinstance(computed, tuple) and len(logged) == len(computed):
        return max((_apart(a, b) for a, b in zip(logged, computed, strict=True)), default=0.0)
    return 0.0 if logged == computed else math.inf


def _apart(logged: float, computed: float) -> float:
    if math.isnan(logged) or math.isnan(computed):
        return 0.0 if math.isnan(logged) and math.isnan(computed) else math.inf
    return 0.0 if logged == computed else abs(logged - computed)

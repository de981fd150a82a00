"""A trial as Algorithm 1 sees it, with its true phases; and Algorithm 1 over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.config import PhasesConfig
from tams_app.errors import LogError
from tams_app.policy.phases import PhaseParameters, PhaseTracker, SmoothedSpeed
from tams_app.records import Phase, Tick
from tams_app.units import NS_PER_S

Codes: TypeAlias = NDArray[np.int8]
Floats: TypeAlias = NDArray[np.float64]

PHASES = tuple(Phase)
CODE = {phase: code for code, phase in enumerate(PHASES)}
NOT_COUNTED = -1  # a tick of no phase: before the start, or not known

# v̄ [m/s], v̄_z [m/s], gripper closed (None: unknown), Δt [s]
StepInput: TypeAlias = tuple[float, float, bool | None, float]


@dataclass(frozen=True, slots=True)
class Motion:
    """What the control loop gave Algorithm 1, tick by tick, n ticks in all.

    `t_s` since the session started, shape (n,). `inputs`: one per tick.
    """

    name: str
    t_s: Floats
    inputs: tuple[StepInput, ...]


@dataclass(frozen=True, slots=True)
class Trial:
    """A motion and its true phases: codes of `PHASES` or NOT_COUNTED, shape (n,)."""

    motion: Motion
    labels: Codes

    @property
    def name(self) -> str:
        return self.motion.name


def motion_of(name: str, ticks: Sequence[Tick], started_ns: int, smoothing_ms: float) -> Motion:
    """The inputs of Algorithm 1 anew from logged ticks, as `ControlLoop` makes them.

    LogError if there are no ticks, or none with an arm state.
    """
    if not any(tick.arm is not None for tick in ticks):
        raise LogError(
            f"{name}: has no state of the arm in it: give a session in which the arm was connected"
        )
    smoothed = SmoothedSpeed(smoothing_ms / 1000)
    inputs: list[StepInput] = []
    last_ns = ticks[0].started_ns
    for tick in ticks:
        if tick.arm is not None:
            smoothed.update(tick.arm.tcp.position, tick.arm.received_ns)
        closed = tick.arm.gripper_closed if tick.arm is not None else None
        period_s = (tick.started_ns - last_ns) / NS_PER_S
        inputs.append((smoothed.speed, smoothed.vertical_speed, closed, period_s))
        last_ns = tick.started_ns
    t_s = np.array([(tick.started_ns - started_ns) / NS_PER_S for tick in ticks])
    return Motion(name, t_s, tuple(inputs))


def infer(motion: Motion, thresholds: PhasesConfig) -> Codes:
    """The phases that Algorithm 1 gives with `thresholds`, codes of `PHASES`, shape (n,)."""
    step = PhaseTracker(PhaseParameters.of(thresholds)).step
    return np.fromiter(
        (
            CODE[step(speed=speed, vertical_speed=vertical, closed=closed, period_s=dt).phase]
            for speed, vertical, closed, dt in motion.inputs
        ),
        np.int8,
        len(motion.inputs),
    )

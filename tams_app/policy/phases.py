"""Online task phase inference (paper, section III-B, Algorithm 1), and its input speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tams_app.config import PhasesConfig
from tams_app.policy.inference import Inference
from tams_app.records import ArmState, Phase, PhaseChange, Vector
from tams_app.units import NS_PER_S
from tams_app.vectors import floats, norm

_MIN_INTERVAL_S = 0.002  # two reports closer than this came out of one socket read


@dataclass(frozen=True, slots=True)
class PhaseDecision:
    """s_t, τ_desc [s], and the line of the algorithm that decided."""

    phase: Phase
    descending_s: float
    reason: str


def infer_phase(
    thresholds: PhasesConfig,
    *,
    speed: float,
    vertical_speed: float,
    closed: bool,
    was_closed: bool,
    previous: Phase,
    descending_s: float,
    period_s: float,
) -> PhaseDecision:
    """One step of Algorithm 1.

    Args:
        thresholds: v_ε and v_z^min, the dwell times T_align and T_pre.
        speed: v̄_t, the smoothed speed of the TCP [m/s].
        vertical_speed: v̄_{z,t}, its smoothed vertical speed, positive upwards [m/s].
        closed: g_t, whether the gripper is closed.
        was_closed: g_{t-1}, whether it was closed in the step before.
        previous: s_{t-1}, the phase of the step before.
        descending_s: τ_desc, how long it has been descending [s].
        period_s: Δt, the time since the step before [s].

    Returns:
        The phase s_t, the new τ_desc, and in words the line of the algorithm that decided.
    """
    if closed and not was_closed:
        return PhaseDecision(Phase.GRASP, descending_s, "gripper closed")
    if was_closed and not closed:
        return PhaseDecision(Phase.RELEASE, descending_s, "gripper opened")
    if speed <= thresholds.v_eps_mm_s / 1000:
        return PhaseDecision(previous, descending_s, "pause: phase held")

    descends = vertical_speed < -thresholds.vz_min_mm_s / 1000
    descending_s = descending_s + period_s if descends else 0.0
    if not closed:
        if descending_s >= thresholds.align_dwell_s:
            return PhaseDecision(Phase.ALIGN, descending_s, "open and descending")
        return PhaseDecision(Phase.REACH, descending_s, "open and moving")
    if descending_s >= thresholds.pre_release_dwell_s:
        return PhaseDecision(Phase.PRE_RELEASE, descending_s, "closed and descending")
    return PhaseDecision(Phase.TRANSPORT, descending_s, "closed and moving")


class PhaseTracker:
    """Algorithm 1 with its memory: s_{t-1}, g_{t-1} and τ_desc; `phase` is REACH at the start."""

    def __init__(self, thresholds: PhasesConfig) -> None:
        self._thresholds = thresholds
        self._closed: bool | None = False if thresholds.inference == "reference" else None
        self._descending_s = 0.0
        self.phase = Phase.REACH

    def step(
        self, *, speed: float, vertical_speed: float, closed: bool | None, period_s: float
    ) -> PhaseDecision:
        """One control period.

        The first step has no gripper edge, but with the inference `reference`. A gripper of unknown
        state is taken for open, so that the next command to close it is an edge. Where it was
        closed and is not known any more, nothing is claimed to be held, and Reach begins. The rest
        is as for `infer_phase`; `closed`: None: not known.
        """
        if self._closed is None:
            self._closed = bool(closed)
        was_closed = self._closed
        self._closed = bool(closed)
        if closed is None and was_closed:
            self._descending_s, self.phase = 0.0, Phase.REACH
            return PhaseDecision(self.phase, self._descending_s, "gripper not known any more")
        decision = infer_phase(
            self._thresholds,
            speed=speed,
            vertical_speed=vertical_speed,
            closed=self._closed,
            was_closed=was_closed,
            previous=self.phase,
            descending_s=self._descending_s,
            period_s=period_s,
        )
        self._descending_s = decision.descending_s
        self.phase = decision.phase
        return decision


class SmoothedSpeed:
    """v̄ = EMA(‖v‖) and v̄_z = EMA(v_z), with α = 1 - exp(-Δt/τ); the first sample initialises.

    v is the difference of successive TCP positions over their receive times; rotation does not
    count. A repeated report changes nothing.
    """

    def __init__(self, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._position: Vector | None = None
        self._received_ns = 0
        self._started = False
        self.speed = 0.0
        self.vertical_speed = 0.0

    def update(self, position: Vector, received_ns: int) -> None:
        """Take in the TCP `position` [m], shape (3,), of the report received at `received_ns`."""
        if self._position is None:
            self._position, self._received_ns = position, received_ns
            return
        interval_s = (received_ns - self._received_ns) / NS_PER_S
        if interval_s < _MIN_INTERVAL_S:
            return
        way = floats(position - self._position)
        self._position, self._received_ns = position, received_ns
        self.smooth(norm(way) / interval_s, way[2] / interval_s, interval_s)

    def smooth(self, speed: float, vertical_speed: float, interval_s: float) -> None:
        """Take in speeds, in any unit, that were measured `interval_s` after those before."""
        if not (self._started and self._time_constant_s):
            self.speed, self.vertical_speed, self._started = speed, vertical_speed, True
            return
        alpha = 1.0 - math.exp(-interval_s / self._time_constant_s)
        self.speed += alpha * (speed - self.speed)
        self.vertical_speed += alpha * (vertical_speed - self.vertical_speed)


class PhaseInference(Inference):
    """Algorithm 1 on an arm's reports: smooths the TCP's speed and keeps the phase.

    `phase` is s_t, `speed` v̄_t and `vertical_speed` v̄_{z,t}.
    """

    def __init__(self, config: PhasesConfig) -> None:
        super().__init__(config)
        self._tracker = PhaseTracker(config)
        self._smoothed = SmoothedSpeed(config.smoothing_ms / 1000)
        self._last_ns: int | None = None

    def step(self, now_ns: int, arm: ArmState | None) -> PhaseChange | None:
        """One control period; Δt is counted from the step before."""
        period_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) / NS_PER_S
        self._last_ns = now_ns
        if arm is not None:
            self._smoothed.update(arm.tcp.position, arm.received_ns)
            self.speed = self._smoothed.speed
            self.vertical_speed = self._smoothed.vertical_speed
        decision = self._tracker.step(
            speed=self.speed,
            vertical_speed=self.vertical_speed,
            closed=arm.gripper_closed if arm is not None else None,
            period_s=period_s,
        )
        if decision.phase is self.phase:
            return None
        self.phase = decision.phase
        return PhaseChange(now_ns, decision.phase, decision.reason)

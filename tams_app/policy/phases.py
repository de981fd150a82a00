"""Online task phase inference (paper, section III-B, Algorithm 1)."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.config import PhasesConfig
from tams_app.records import Phase


@dataclass(frozen=True, slots=True)
class PhaseParameters:
    """Thresholds v_ε, v_z^min [m/s] and dwell times T_align, T_pre [s] of Algorithm 1."""

    v_eps: float
    vz_min: float
    align_dwell_s: float
    pre_release_dwell_s: float

    @staticmethod
    def of(config: PhasesConfig) -> PhaseParameters:
        return PhaseParameters(
            v_eps=config.v_eps_mm_s / 1000,
            vz_min=config.vz_min_mm_s / 1000,
            align_dwell_s=config.align_dwell_s,
            pre_release_dwell_s=config.pre_release_dwell_s,
        )


@dataclass(frozen=True, slots=True)
class PhaseDecision:
    """s_t, τ_desc [s], and the line of the algorithm that decided."""

    phase: Phase
    descending_s: float
    reason: str


def infer_phase(
    parameters: PhaseParameters,
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

    `speed` is v̄_t and `vertical_speed` v̄_{z,t} [m/s], `closed` g_t, `was_closed` g_{t-1},
    `previous` s_{t-1}, `descending_s` τ_desc [s], `period_s` Δt [s].
    """
    if closed and not was_closed:
        return PhaseDecision(Phase.GRASP, descending_s, "gripper closed")
    if was_closed and not closed:
        return PhaseDecision(Phase.RELEASE, descending_s, "gripper opened")
    if speed <= parameters.v_eps:
        return PhaseDecision(previous, descending_s, "pause: phase held")

    descending_s = descending_s + period_s if vertical_speed < -parameters.vz_min else 0.0
    if not closed:
        if descending_s >= parameters.align_dwell_s:
            return PhaseDecision(Phase.ALIGN, descending_s, "open and descending")
        return PhaseDecision(Phase.REACH, descending_s, "open and moving")
    if descending_s >= parameters.pre_release_dwell_s:
        return PhaseDecision(Phase.PRE_RELEASE, descending_s, "closed and descending")
    return PhaseDecision(Phase.TRANSPORT, descending_s, "closed and moving")


class PhaseTracker:
    """Algorithm 1 with its memory: s_{t-1}, g_{t-1} and τ_desc. Starts in REACH."""

    def __init__(self, parameters: PhaseParameters) -> None:
        self._parameters = parameters
        self._closed: bool | None = None
        self._descending_s = 0.0
        self.phase = Phase.REACH

    def step(
        self, *, speed: float, vertical_speed: float, closed: bool | None, period_s: float
    ) -> PhaseDecision:
        """One control period; `closed` None (gripper state unknown) counts as unchanged.

        The first step has no edge. A gripper unknown then is taken for open, so that the first
        command to close it is the edge it is.
        """
        if self._closed is None:
            self._closed = bool(closed)
        was_closed = self._closed
        self._closed = was_closed if closed is None else closed
        decision = infer_phase(
            self._parameters,
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

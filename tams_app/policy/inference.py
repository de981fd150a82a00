"""Inference of the phase of the task: what one is, and the implementations by name."""

from __future__ import annotations

from tams_app.config import PhasesConfig
from tams_app.records import ArmState, Phase, PhaseChange
from tams_app.registry import Registry


class Inference:
    """From the arm's motion to the phase of the task.

    A new one is a subclass with `step`, entered in `INFERENCES`, or an entry point of
    `tams.inference`.
    """

    phase = Phase.REACH
    """The phase now."""
    speed = 0.0
    """Smoothed speed of the TCP [m/s]."""
    vertical_speed = 0.0
    """Smoothed vertical speed of the TCP [m/s], upwards."""

    def __init__(self, config: PhasesConfig) -> None:
        """Begin at the first phase of the task.

        Args:
            config: `policy.phases` of the configuration.
        """

    def step(self, now_ns: int, arm: ArmState | None) -> PhaseChange | None:
        """Take in the arm's newest report; called in each control tick, so it must not block.

        Args:
            now_ns: the time of the tick [ns].
            arm: the newest report, by whose `received_ns` a repeated one is known; None: none yet.

        Returns:
            The change if another phase has begun, else None.
        """
        raise NotImplementedError


INFERENCES: Registry[type[Inference]] = Registry(
    "policy.phases.inference",
    "tams.inference",
    dict.fromkeys(("motion", "reference"), "tams_app.policy.phases:PhaseInference"),
)
"""The inferences by their word for `policy.phases.inference`; entry points of `tams.inference`."""

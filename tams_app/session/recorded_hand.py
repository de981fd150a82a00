"""The hand of an earlier session, taken from its log."""

from __future__ import annotations

from pathlib import Path

from hw.sim.operator.replayed_controller import ReplayedController
from tams_app.errors import ConfigError
from tams_app.recording import read_ticks


def recorded_hand(log: Path) -> ReplayedController:
    """A controller that moves as the one in `log` did; LogError if that is none of ours."""
    readings = [(tick.started_ns, tick.controller) for tick in read_ticks(log)]
    if not readings:
        raise ConfigError(
            f"rig.hand_trajectory: {log} holds no tick of a hand: name a session that ran"
        )
    return ReplayedController(readings)

"""Who moves the controller in virtual time: the participant who sees, or a recorded hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hw.controller import Controller
from hw.sim.operator.seeing import Images, Reliance, SeeingParticipant
from hw.sim.operator.task import Stage
from tams_app.config import Config
from tams_app.records import OperatorGlance
from tams_app.session.recorded_hand import recorded_hand

_TO_BLOCK = frozenset((Stage.REACH, Stage.TURN, Stage.DESCEND, Stage.CLOSE, Stage.LIFT))


def make_hand(
    config: Config,
    participant_seed: int,
    frames: Images,
    record: Callable[[OperatorGlance], None],
) -> tuple[Controller, Callable[[int], object]]:
    """The controller in the hand that the configuration names, and what precedes each sample.

    That is the hand of `rig.hand_trajectory`, which looks at nothing, or else the simulated
    participant's, who gets `frames` and the feel of the controller and may take a glance at the
    time [ns] that is passed; `record` keeps each glance.
    """
    if config.rig.hand_trajectory is not None:
        return recorded_hand(Path(config.rig.hand_trajectory)), lambda _now_ns: None

    def tell(told: Reliance) -> None:
        stage = participant.operator.stage
        record(
            OperatorGlance(
                t_ns=told.t_ns,
                stage=stage.value,
                to_block=told.to_block,
                to_container=told.to_container,
                about_block=stage in _TO_BLOCK,
                block_sigma=told.block_sigma,
                container_sigma=told.container_sigma,
                lag_ns=told.lag_ns,
                hanging=told.frozen,
            )
        )

    participant = SeeingParticipant(config, participant_seed, frames, tell)
    return participant.controller, participant.eyes.watch

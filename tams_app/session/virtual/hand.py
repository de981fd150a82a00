"""Who moves the controller in virtual time: the participant who sees, or a recorded hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from hw.controller import Controller
from hw.sim.operator.seeing import Images, Reliance, SeeingParticipant
from hw.sim.operator.task import Stage
from tams_app.config import Config
from tams_app.records import OperatorGlance
from tams_app.session.recorded_hand import recorded_hand

_TO_BLOCK = frozenset((Stage.REACH, Stage.TURN, Stage.DESCEND, Stage.CLOSE, Stage.LIFT))


class Hand(Protocol):
    """A controller, and what precedes each of its samples."""

    controller: Controller

    def prepare(self, now_ns: int) -> None:
        """Called before each sample."""


class SeeingHand:
    """The simulated participant, who gets `frames` and the feel of the controller."""

    def __init__(
        self,
        config: Config,
        participant_seed: int,
        frames: Images,
        record: Callable[[OperatorGlance], None],
    ) -> None:
        """`record` keeps each glance."""
        self._participant = SeeingParticipant(config, participant_seed, frames, self._tell)
        self._record = record
        self.controller: Controller = self._participant.controller

    def prepare(self, now_ns: int) -> None:
        """Look, if it is time for a glance."""
        self._participant.eyes.watch(now_ns)

    def _tell(self, told: Reliance) -> None:
        stage = self._participant.operator.stage
        self._record(
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


class RecordedHand:
    """The hand of an earlier session; it looks at nothing."""

    def __init__(self, log: Path) -> None:
        self.controller: Controller = recorded_hand(log)

    def prepare(self, now_ns: int) -> None:
        """It moves as it moved."""


def make_hand(
    config: Config,
    participant_seed: int,
    frames: Images,
    record: Callable[[OperatorGlance], None],
) -> Hand:
    """The hand of the configuration: `rig.hand_trajectory`, or else the participant's."""
    if config.rig.hand_trajectory is not None:
        return RecordedHand(Path(config.rig.hand_trajectory))
    return SeeingHand(config, participant_seed, frames, record)

"""The demo's operator, who reads the true scene instead of looking at images.

For `make run`, calibration and recorded hands: it shows that control, arm and task work, and says
nothing about video. The operator of a study is `hw.sim.operator.seeing.SeeingParticipant`.
"""

from __future__ import annotations

from collections.abc import Callable

from hw.sim.operator.operator import Operator
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.perception import Estimate, Percept
from hw.sim.operator.servoing import operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import Config
from tams_app.records import SceneTruth


class TruePerception:
    """Perfect eyes: every view is the true scene, without delay beyond that of its source."""

    def __init__(self, read: Callable[[], SceneTruth | None]) -> None:
        self._read = read

    def look(self, now_ns: int) -> Percept | None:
        truth = self._read()
        if truth is None:
            return None
        return Percept(
            truth.t_ns,
            Estimate(truth.tcp),
            Estimate(truth.block),
            Estimate(truth.container),
            truth.fingers_opening,
        )


def demo_controller(
    config: Config,
    read: Callable[[], SceneTruth | None],
    *,
    confirms: bool = True,
    participant: int | None = None,
) -> VirtualController:
    """The rig's controller, held by an operator who sees the true scene.

    Args:
        config: Its seed is that of the operator's hand and of the tracking noise.
        read: The true scene as the operator sees it now; None while there is nothing to see.
        confirms: Whether the operator arms the arm by the menu button.
        participant: Seed of the participant with whose traits the operator works; None for the
            configured script.
    """
    settings, eyes = config.rig.operator, TruePerception(read)
    seed, profile = config.seed, None
    if participant is not None:
        seed, profile = participant, ParticipantProfile.draw(participant)
    operator = Operator(operator_hand(config), settings, eyes, seed, confirms, profile)
    return VirtualController(operator, settings, config.seed, rig_wiring(config))

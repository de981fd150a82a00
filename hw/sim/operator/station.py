"""The operator's station: the participant's eyes before the screen, his hand on the controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.operator import Operator
from hw.sim.operator.operator_hand import operator_hand
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.seeing import Images, Reliance, SeeingPerception
from hw.sim.operator.virtual_controller import VirtualController
from hw.sim.operator.wiring import rig_wiring
from tams_app.config import Config


@dataclass(frozen=True, slots=True)
class Station:
    """One participant at work; `eyes.watch` comes before each sample of the controller."""

    eyes: SeeingPerception
    operator: Operator
    controller: VirtualController


def seat(
    config: Config, participant: int, images: Images, tell: Callable[[Reliance], None]
) -> Station:
    """Participant `participant` before `images`, which are all that he gets of the scene.

    `tell` hears of each glance. The same seeds, images and times give the same motion.
    """
    profile, asked = ParticipantProfile.draw(participant), EfferenceCopy()
    eyes = SeeingPerception(images, asked, profile.sampling_s, profile.visuomotor_s, tell)
    settings = config.rig.operator
    hand = operator_hand(config)
    operator = Operator(hand, settings, eyes, participant, True, profile, asked)
    controller = VirtualController(operator, settings, config.seed, rig_wiring(config))
    return Station(eyes, operator, controller)

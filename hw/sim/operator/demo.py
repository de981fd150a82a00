"""Operators who read the true scene instead of looking at images: of the demo, and of a sweep.

For `make run`, calibration and recorded hands: they show that control, arm and task work, whatever
the video is like. The operator of a study is `hw.sim.operator.seeing.SeeingParticipant`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from hw.sim.operator.operator import SimulatedOperator
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import Percept, operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import Config
from tams_app.records import SceneTruth
from tams_app.units import NS_PER_S


class TruePerception:
    """Perfect eyes: every view is the true scene, without delay beyond that of its source."""

    def __init__(self, read: Callable[[], SceneTruth | None]) -> None:
        self._read = read

    def look(self, now_ns: int) -> Percept | None:
        truth = self._read()
        if truth is None:
            return None
        opening = truth.fingers_opening
        return Percept(truth.t_ns, truth.tcp, truth.block, truth.container, opening)


def demo_controller(
    config: Config,
    read: Callable[[], SceneTruth | None],
    *,
    confirms: bool = True,
    participant: int | None = None,
) -> VirtualController:
    """The rig's controller, held by an operator who sees the true scene that `read` gives.

    `confirms`: they arm the arm by the menu button. `participant`: the seed of whose traits they
    have; None for the configured script.
    """
    settings, eyes = config.rig.operator, TruePerception(read)
    if participant is None:
        seed, traits = config.seed, ParticipantProfile.scripted(settings)
    else:
        seed, traits = participant, ParticipantProfile.draw(participant)
    operator = SimulatedOperator(operator_hand(config), settings, eyes, traits, seed, confirms)
    return VirtualController(operator, settings, config.seed, rig_wiring(config))


class SharpEyedHand:
    """A participant who sees the true scene, as often and as late as they would see images."""

    def __init__(self, config: Config, participant: int, truth: Callable[[], SceneTruth]) -> None:
        profile = ParticipantProfile.draw(participant)
        self._truth = truth
        self._sampling_ns = round(profile.sampling_s * NS_PER_S)
        self._delay_ns = round(profile.visuomotor_s * NS_PER_S)
        self._glance_ns = 0  # when the next one is due
        self._coming: deque[tuple[int, SceneTruth]] = deque()
        self._seen: SceneTruth | None = None
        self.controller = demo_controller(config, lambda: self._seen, participant=participant)

    def prepare(self, now_ns: int) -> None:
        """Look, if it is time for a glance, and understand what was seen earlier."""
        if now_ns >= self._glance_ns:
            self._glance_ns = now_ns + self._sampling_ns
            self._coming.append((now_ns + self._delay_ns, self._truth()))
        while self._coming and self._coming[0][0] <= now_ns:
            self._seen = self._coming.popleft()[1]

"""A participant who sees the scene itself in place of images of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from hw.controller import Controller
from hw.sim.operator.demo import demo_controller
from hw.sim.operator.participant import ParticipantProfile
from tams_app.config import Config
from tams_app.records import SceneTruth
from tams_app.units import NS_PER_S


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
        self.controller: Controller = demo_controller(
            config, lambda: self._seen, participant=participant
        )

    def prepare(self, now_ns: int) -> None:
        """Look, if it is time for a glance, and understand what was seen earlier."""
        if now_ns >= self._glance_ns:
            self._glance_ns = now_ns + self._sampling_ns
            self._coming.append((now_ns + self._delay_ns, self._truth()))
        while self._coming and self._coming[0][0] <= now_ns:
            self._seen = self._coming.popleft()[1]

"""The operator of a trial in virtual time: what they see at once, and what they hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hw.controller import Controller
from hw.sim.operator.seeing import OnScreen, SeeingParticipant
from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import Image, ShownFrame, SteeredBy
from tams_app.robot.operator import Operator
from tams_app.station.fresh_video import Displays, FreshVideo
from tams_app.station.operator_process import Show, on_screen
from tams_app.station.recorded_hand import recorded_hand
from tams_app.teleop.hands import hand_of


class VirtualOperator(Operator):
    """A seeing participant, or a recorded hand, which sees nothing.

    `kind`: which of them. Each frame is on the screen as soon as it is decoded.
    """

    def __init__(
        self,
        config: Config,
        participant_seed: int,
        log: Journal,
        shows: Mapping[str, Show],
    ) -> None:
        """`shows`: by view, how its frames are shown where they are predicted.

        LogError or ConfigError where the recorded hand cannot be read.
        """
        self._hand = hand_of(config)
        self._log = log
        self._fresh = FreshVideo(config.video.views, Displays())
        self._shows = shows
        self._frames: dict[str, tuple[int, Image] | None] = dict.fromkeys(config.video.views)
        self._participant: SeeingParticipant | None = None
        trajectory = config.rig.hand_trajectory
        if trajectory is not None:
            self.kind = "recorded"
            self._controller: Controller = recorded_hand(Path(trajectory))
        else:
            self.kind = "seeing"
            self._participant = SeeingParticipant(config, participant_seed, self.screen)
            self._controller = self._participant.controller

    def take_controller(self) -> Controller:
        self._controller.start()
        return self._controller

    @property
    def hand(self) -> str:
        return self._hand

    @property
    def is_simulated(self) -> bool:
        return True

    def steered_by(self, view: str) -> SteeredBy:
        return self._fresh.of(view)

    def screen(self, now_ns: int) -> OnScreen:
        return on_screen(self._frames, self._shows, now_ns)

    def see(self, shown: ShownFrame) -> None:
        """A frame was decoded; each view's in order."""
        self._fresh.shown(shown)
        self._frames[shown.view] = shown.capture_ns, shown.image
        self._log.record(shown)

    def look(self, now_ns: int) -> None:
        """Before each sample: look if it is time to."""
        glance = self._participant.watch(now_ns) if self._participant is not None else None
        if glance is not None:
            self._log.record(glance)

"""The operator at this computer, as the robot's session knows them: both sides in one process."""

from __future__ import annotations

from collections.abc import Mapping

from hw.controller import Controller
from tams_app.config import Config
from tams_app.records import SteeredBy
from tams_app.robot.operator import StreamedOperator
from tams_app.station.receivers import Receivers
from tams_app.station.station import Station
from tams_app.teleop.hands import hand_of
from tams_app.video.core.codecs import Decoder
from tams_app.video.core.frame_identity import SentFrames
from tams_app.video.core.repair import RepairRule
from tams_app.video.live.udp import ViewPorts


class LocalOperator(StreamedOperator):
    """Joins the two sides without a link: the control loop samples the controller itself."""

    def __init__(self, station: Station, config: Config, decoder: Decoder) -> None:
        self._station, self._config, self._decoder = station, config, decoder
        self._receivers: Receivers | None = None

    def open(
        self, rule: RepairRule, feedback: bool, sent: Mapping[str, SentFrames]
    ) -> dict[str, ViewPorts]:
        identify = {view: frames.find for view, frames in sent.items()}
        self._receivers = self._station.receive(rule, feedback, identify, self._decoder)
        return self._receivers.ports

    def connect(self, entrances: Mapping[str, ViewPorts]) -> None:
        assert self._receivers is not None, "open it first"
        self._receivers.start(entrances)

    def take_controller(self) -> Controller:
        return self._station.take_controller()

    @property
    def hand(self) -> str:
        return hand_of(self._config)

    @property
    def is_simulated(self) -> bool:
        return self._config.operator_is_simulated

    def steered_by(self, view: str) -> SteeredBy:
        return self._station.steered_by(view)

    def poll(self) -> str:
        return self._station.poll()

    def close(self) -> None:
        if self._receivers is not None:
            self._receivers.close()

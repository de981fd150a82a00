"""The operator at this computer, as the robot's session knows them: both sides in one process."""

from __future__ import annotations

from hw.controller import Controller
from tams_app.config import Config
from tams_app.records import SteeredBy
from tams_app.robot.operator import Operator
from tams_app.station.hand import OperatorHand
from tams_app.station.receivers import Receivers
from tams_app.teleop.hands import hand_of


class LocalOperator(Operator):
    """Joins the two sides without a link: the control loop samples the controller itself."""

    def __init__(self, hand: OperatorHand, receivers: Receivers, config: Config) -> None:
        self._hand, self._receivers, self._config = hand, receivers, config

    def take_controller(self) -> Controller:
        return self._hand.take_controller()

    @property
    def hand(self) -> str:
        return hand_of(self._config)

    @property
    def is_simulated(self) -> bool:
        return self._config.operator_is_simulated

    def steered_by(self, view: str) -> SteeredBy:
        return self._receivers.steered_by(view)

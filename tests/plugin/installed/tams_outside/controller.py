"""A pedal that knows no place, with the words in which its operator is told what to do."""

from dataclasses import replace

import numpy as np

from hw.controller import Controller
from hw.make_controller import ControllerParts
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.teleop.hands import HANDS, HandWords

AWAY = ControllerSample.released(ControllerStatus.DISCONNECTED)
PLACE = Pose(np.array([0.0, 1.0, 0.0]), Rotation.identity())


class Pedal(Controller):
    pressed = False
    _started = False

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        if not self._started:
            return AWAY
        status, trigger = ControllerStatus.OK, float(self.pressed)
        times = {"pose_ns": now_ns, "buttons_ns": now_ns}
        return replace(AWAY, status=status, pose=PLACE, trigger=trigger, **times)

    def pulse(self, haptic: Haptic) -> None:
        """It cannot be felt."""

    def close(self) -> None:
        self._started = False


def make(_parts: ControllerParts) -> Controller:
    return Pedal()


HANDS["outside"] = HandWords(
    deadman="the pedal",
    controls=(("pedal", "deadman"),),
    device="the pedal",
    wake="step on the pedal",
    connect="plug the pedal in",
    check="check the pedal",
    release="take the foot off the pedal",
)

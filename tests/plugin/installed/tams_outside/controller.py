"""A controller at rest, with the words in which its operator is told what to do."""

import numpy as np

from hw.controller import Controller
from hw.make_controller import ControllerParts
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.teleop.hands import HANDS, HandWords


class Pedal(Controller):
    def start(self) -> None:
        """There is nothing to connect to."""

    def sample(self, now_ns: int) -> ControllerSample:
        pose = Pose(np.array([0.0, 1.0, 0.0]), Rotation.identity())
        return ControllerSample(
            ControllerStatus.OK, pose, now_ns, now_ns, 0.0, 0.0, False, False, False
        )

    def pulse(self, haptic: Haptic) -> None:
        """It cannot be felt."""

    def close(self) -> None:
        """There is nothing to let go of."""


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

"""What counts as a stroke."""

import numpy as np
import pytest
from scipy.spatial import transform

from calibration.frame.fit import BeginAgainError
from calibration.frame.sources import StrokeCapture
from tams_app.config import load_config
from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed

STEP_NS = NS_PER_S // 120
TRUTH = transform.Rotation.random(random_state=11).as_matrix()


class Player:
    """Feeds samples, one control period apart."""

    def __init__(self):
        self.capture = StrokeCapture(load_config())
        self.now_ns = NS_PER_S

    def give(self, trigger, x=0.0, status=ControllerStatus.OK, new_pose=True):
        self.now_ns += STEP_NS
        pose = Pose(np.array([x, 1.0, 0.0]), Rotation.identity())
        if status is not ControllerStatus.OK:
            pose = None
        pose_ns = self.now_ns if new_pose else self.now_ns - STEP_NS
        sample = ControllerSample.released(status, pose, pose_ns, self.now_ns, trigger)
        return self.capture.take(sample, self.now_ns)


def test_a_stroke_is_what_arrives_between_squeeze_and_release():
    player = Player()
    # a trigger that was held from the start begins no stroke
    assert [player.give(trigger, x=9.0) for trigger in (1.0, 1.0, 0.0)] == [None] * 3
    held = [player.give(1.0, x=n / 100) for n in range(20)]
    held.append(player.give(1.0, x=0.19, new_pose=False))  # it counts once
    assert held == [None] * 21
    assert len(player.capture.so_far) == 20
    done = player.give(0.0, x=9.0)
    assert done[:, 0] == pytest.approx(np.arange(20) / 100)
    assert player.capture.so_far is None


def test_a_recentred_headset_ends_everything_even_between_strokes():
    player = Player()
    player.give(0.0)
    with pytest.raises(BeginAgainError, match="The headset was recentred"):
        player.give(0.0, status=ControllerStatus.TRACKING_FRAME_CHANGED)

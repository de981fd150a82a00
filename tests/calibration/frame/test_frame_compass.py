"""What counts as a stroke, and that the direction lit up is the one the arm would be sent in."""

import numpy as np
import pytest
from scipy.spatial import transform

from calibration.frame.asking import Compass, direction_of
from calibration.frame.fit import BeginAgainError
from calibration.frame.sources import SIX_DIRECTIONS, StrokeCapture
from calibration.frame.wizard import rows
from tams_app.config import load_config
from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.untimed


def lit_by(velocity, hand, seconds=0.5):
    compass, now_ns = Compass(load_config(), hand), NS_PER_S
    for number in range(round(seconds * 120)):
        now_ns += NS_PER_S // 120
        pose = Pose(velocity * number / 120, Rotation.identity())
        sample = ControllerSample.released(ControllerStatus.OK, pose, now_ns, now_ns, 1)
        compass.update(sample, now_ns, held=True)
    return compass


@pytest.mark.parametrize("way", SIX_DIRECTIONS, ids=lambda way: way.name)
def test_each_direction_lights_up_for_a_hand_that_moves_along_it(way):
    truth = transform.Rotation.random(random_state=3).as_matrix()
    hand = load_config().hand.model_copy(update={"rotation": rows(truth)})
    compass = lit_by(0.2 * truth.T @ way.direction, hand)
    assert compass.lit == way
    assert compass.mostly() == way
    assert compass.mostly() is None  # asked anew


def test_a_small_scale_needs_no_faster_hand():
    hand = load_config().hand.model_copy(
        update={"translation_scale": 0.2, "rotation": rows(np.eye(3))}
    )
    assert lit_by(0.1 * SIX_DIRECTIONS[0].direction, hand).mostly() == SIX_DIRECTIONS[0]


@pytest.mark.parametrize(
    ("velocity", "name"),
    [
        ((0.2, 0.0, 0.0), "+x"),
        ((0.0, -0.2, 0.05), "−y"),
        ((0.0, 0.02, -0.1), "−z"),
        ((0.01, 0.0, 0.0), None),
        ((0.2, 0.2, 0.0), None),
        ((0.0, 0.0, 0.0), None),
    ],
)
def test_slow_and_slanting_motion_lights_nothing(velocity, name):
    lit = direction_of(np.array(velocity))
    assert (lit.name if lit else None) == name


class Player:
    """Feeds samples, one control period apart."""

    def __init__(self):
        self.capture = StrokeCapture(load_config())
        self.now_ns = NS_PER_S

    def give(self, trigger, x=0.0, status=ControllerStatus.OK, new_pose=True):
        self.now_ns += NS_PER_S // 120
        pose = Pose(np.array([x, 1.0, 0.0]), Rotation.identity())
        if status is not ControllerStatus.OK:
            pose = None
        pose_ns = self.now_ns if new_pose else self.now_ns - NS_PER_S // 120
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

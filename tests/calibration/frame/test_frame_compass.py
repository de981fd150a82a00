"""The direction that lights up is the one the product would send the arm in."""

import numpy as np
import pytest
from scipy.spatial import transform

from calibration.frame.asking import Compass, direction_of
from calibration.frame.sources import SIX_DIRECTIONS
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

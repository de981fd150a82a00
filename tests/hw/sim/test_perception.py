import numpy as np
from scipy.spatial.transform import Rotation

from hw.sim.perception import TruePerception
from tams_app.records import Pose, SceneTruth


def _truth() -> SceneTruth:
    poses = [Pose(np.full(3, value), Rotation.identity()) for value in (0.1, 0.2, 0.3)]
    return SceneTruth(5, *poses, block_speed=0.0, fingers_opening=0.016)


def test_there_is_nothing_to_see_before_the_first_truth():
    assert TruePerception(lambda: None).look(1) is None


def test_true_perception_is_certain_and_dated_by_the_scene():
    truth = _truth()
    percept = TruePerception(lambda: truth).look(99)
    assert percept is not None
    assert percept.t_ns == 5
    assert percept.block.pose is truth.block
    assert percept.container.pose is truth.container
    assert percept.tcp.pose is truth.tcp
    assert percept.tcp.position_sigma == percept.block.rotation_sigma == 0.0
    assert percept.fingers_opening == 0.016

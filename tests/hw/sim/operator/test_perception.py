from dataclasses import replace

import numpy as np
import pytest

from hw.sim.operator.demo import TruePerception
from hw.sim.operator.perception import GapSigmas, PoseEstimate
from tams_app.records import Pose, SceneTruth
from tams_app.rotation import Rotation

pytestmark = pytest.mark.untimed


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


def test_gaps_are_as_uncertain_as_both_places_unless_they_were_seen_together():
    percept = TruePerception(_truth).look(1)
    vague = replace(
        percept,
        tcp=PoseEstimate(percept.tcp.pose, 0.003, 0.1),
        block=PoseEstimate(percept.block.pose, 0.004, 0.2),
    )
    assert vague.gaps.block == pytest.approx(0.005)
    assert vague.gaps.container == pytest.approx(0.003)
    assert vague.gaps.heading == pytest.approx(0.3)
    seen = GapSigmas(0.001, 0.002, 0.01)
    assert replace(vague, seen_gaps=seen).gaps is seen

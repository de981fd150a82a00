import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.sim.operator.demo import TruePerception
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import (
    GapSigmas,
    HandMap,
    approach,
    grasp_turn,
    speed_factor,
)
from tams_app.config import HandConfig
from tams_app.records import Pose, SceneTruth
from tams_app.rotation import Rotation

pytestmark = pytest.mark.untimed

DOWN = Rotation.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]])
angles = st.floats(-math.pi, math.pi)


@given(angles, angles)
def test_the_fingers_take_the_nearest_face_of_a_standing_block(block_yaw, tool_yaw):
    block = Rotation.from_rotvec((0, 0, block_yaw))
    tool = Rotation.from_rotvec((0, 0, tool_yaw)) * DOWN
    turn = grasp_turn(tool, block)
    assert abs(turn[2]) <= math.pi / 4 + 1e-6
    closing = (Rotation.from_rotvec(turn) * tool).apply([0, 1, 0])
    assert np.abs(block.inv().apply(closing)).max() == pytest.approx(1.0, abs=1e-6)


@given(st.floats(-0.5, 0.5))
def test_the_fingers_never_close_along_the_length_of_a_lying_block(yaw):
    lying = Rotation.from_rotvec((0, 0, yaw)) * Rotation.from_rotvec((math.pi / 2, 0, 0))
    turn = grasp_turn(DOWN, lying)
    closing = (Rotation.from_rotvec(turn) * DOWN).apply([0, 1, 0])
    assert abs(lying.inv().apply(closing)[0]) == pytest.approx(1.0, abs=1e-6)


def test_a_tilted_gripper_is_brought_upright():
    tilted = Rotation.from_rotvec([0.1, -0.05, 0.0]) * DOWN
    for _ in range(5):
        tilted = Rotation.from_rotvec(grasp_turn(tilted, Rotation.identity())) * tilted
    assert tilted.apply([0, 0, 1]) == pytest.approx([0, 0, -1], abs=1e-3)


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.floats(0.01, 0.3))
def test_approach_heads_for_the_goal_and_keeps_the_speed(error, speed):
    velocity = approach(np.array(error), speed, gain_per_s=2.8)
    assert np.linalg.norm(velocity) <= speed * (1 + 1e-9)
    assert velocity @ np.array(error) >= 0.0


def test_care_slows_down_and_then_waits():
    assert speed_factor(0.001, 0.003) == 1.0
    assert 0.0 < speed_factor(0.0045, 0.003) < 1.0
    assert speed_factor(0.006, 0.003) == speed_factor(math.inf, 0.003) == 0.0


def test_the_hand_map_knows_the_directions_roughly_and_itself_exactly():
    config = HandConfig(translation_scale=2.0)
    hand_map = HandMap(config, ParticipantProfile.draw(1), np.random.default_rng(3))
    wished = np.array([0.1, -0.05, 0.02])
    hand = hand_map.hand_linear @ wished
    assert hand_map.tool_linear @ hand == pytest.approx(wished)
    true = 2.0 * np.array(config.rotation) @ hand
    assert true == pytest.approx(wished, abs=0.03)
    assert not np.allclose(true, wished, atol=1e-4)


def test_true_perception_is_certain_and_dated_by_the_scene():
    assert TruePerception(lambda: None).look(1) is None
    poses = [Pose(np.full(3, value), Rotation.identity()) for value in (0.1, 0.2, 0.3)]
    truth = SceneTruth(5, *poses, block_speed=0.0, fingers_opening=0.016)
    seen = TruePerception(lambda: truth).look(99)
    assert seen is not None
    assert [seen.tcp, seen.block, seen.container] == [truth.tcp, truth.block, truth.container]
    assert (seen.t_ns, seen.fingers_opening) == (5, 0.016)
    assert (seen.tcp_sigma, seen.block_sigma, seen.gaps) == (0.0, 0.0, GapSigmas())

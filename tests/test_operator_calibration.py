"""How the operator's certainty is judged, on beliefs whose errors are known."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.operator_calibration import (
    SPEEDS_MM_S,
    NormalisedErrors,
    Within,
    calibration,
    normalised_errors,
)
from hw.sim.operator.belief import Belief
from hw.sim.operator.belief_state import BLOCK, BLOCK_YAW, CONTAINER, SIZE, TOOL, TOOL_YAW
from hw.sim.operator.seeing import fixed_cameras, wrist_camera
from hw.sim.operator.task import Stage
from hw.sim.operator.vision.detections import Thing
from tams_app.records import Pose, SceneTruth

pytestmark = pytest.mark.untimed

DOWN = Rotation.from_euler("x", math.pi)


def _truth(tcp=(0.3, 0.0, 0.1), block=(0.33, -0.12, 0.01), yaw=0.2):
    return SceneTruth(
        0,
        Pose(np.array(block), Rotation.from_euler("z", yaw)),
        Pose(np.array([0.33, 0.15, 0.0]), Rotation.identity()),
        Pose(np.array(tcp), DOWN),
        0.0,
        0.016,
    )


def _belief(sigma_m=0.001, seen=True):
    """One who is right about everything, to `sigma_m` and 0.01 rad."""
    belief, truth = Belief(fixed_cameras(), {"eih": wrist_camera()}), _truth()
    belief.state[TOOL], belief.state[BLOCK] = truth.tcp.position, truth.block.position
    belief.state[CONTAINER] = truth.container.position[:2]
    belief.state[TOOL_YAW], belief.state[BLOCK_YAW] = 0.0, 0.2
    variance = np.full(SIZE, sigma_m**2)
    variance[[TOOL_YAW, BLOCK_YAW]] = 0.01**2
    belief.covariance[:] = np.diag(variance)
    belief.seen = dict.fromkeys(Thing, seen)
    return belief


def _errors(belief, *shown, stage=Stage.REACH):
    return normalised_errors(belief, stage, 0.0, shown or (_truth(),)).by_quantity


def test_errors_are_counted_in_sigmas_of_the_way_not_of_a_place():
    belief = _belief()
    assert _errors(belief)["block"] == pytest.approx([0.0, 0.0], abs=1e-9)
    belief.state[BLOCK] += (0.002, 0.0, 0.0)
    assert _errors(belief)["block"] == pytest.approx([math.sqrt(2.0), 0.0])
    belief.state[TOOL] += (0.002, 0.0, 0.0)
    assert _errors(belief)["block"] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert _errors(belief)["container"] == pytest.approx([-math.sqrt(2.0), 0.0])


def test_he_is_held_to_the_mean_of_what_the_views_showed():
    shown = [_truth(tcp=(0.3 + part, 0.0, 0.1)) for part in (-0.003, 0.0, 0.003)]
    assert _errors(_belief(), *shown)["block"] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_heading_is_judged_modulo_a_quarter_turn_and_before_the_grasp():
    belief = _belief()
    belief.state[BLOCK_YAW] += math.pi / 2 + 0.01
    assert _errors(belief)["heading"] == pytest.approx([0.01 / math.hypot(0.01, 0.01)])
    assert "heading" not in _errors(belief, stage=Stage.CARRY)
    belief.covariance[BLOCK_YAW, BLOCK_YAW] = 1.0
    assert _errors(belief)["heading"] == []


def test_what_has_not_been_seen_is_not_judged():
    assert _errors(_belief(seen=False)) == {}
    assert normalised_errors(_belief(), Stage.REACH, 0.0, []).by_quantity == {}


def test_errors_drawn_as_large_as_believed_are_within_as_often_as_they_should():
    within = Within.of(list(np.random.default_rng(0).normal(size=20_000)))
    assert (within.one, within.two, within.three) == pytest.approx((0.683, 0.954, 0.997), abs=0.01)
    assert within.n == 20_000


def test_tables_tell_apart_quantities_stages_and_speeds():
    glances = [
        NormalisedErrors(Stage.REACH, 0.001, {"block": [0.5, 1.5]}),
        NormalisedErrors(Stage.CARRY, 0.2, {"block": [2.5, 3.5], "heading": []}),
    ]
    tables = calibration(glances)
    assert set(tables["block"]) == {"all", "reach", "carry", "0-5 mm/s", "50- mm/s"}
    assert tables["block"]["all"] == {"n": 4, "one": 0.25, "two": 0.5, "three": 0.75}
    assert tables["heading"] == {}
    assert [NormalisedErrors(Stage.REACH, speed, {}).speed for speed in (0, 0.01, 0.03, 1)] == list(
        SPEEDS_MM_S
    )

import numpy as np
import pytest

from hw.sim.operator.vision.solids import (
    ORANGE,
    block_box,
    block_corners,
    sketch,
    tool_boxes,
    tool_rotation,
)
from hw.sim.operator.vision.views import fixed_cameras

pytestmark = pytest.mark.untimed

ASIDE = np.array((0.0, 0.1, 0.0))
CAMERA = fixed_cameras()["gt"]
PLACE = np.array([0.34, -0.08, 0.01])


def _middle():
    return CAMERA.project(PLACE[None])[0]


def test_what_the_gripper_hides_of_the_block_does_not_count():
    over = PLACE + np.array((0.0, 0.0, 0.002))
    boxes = [*tool_boxes(over, tool_rotation(0.0), 0.016), block_box(PLACE, 0.0)]
    hidden = sketch(CAMERA, boxes, ORANGE, _middle(), 30)
    assert 0.2 < hidden.visible < 0.8
    aside = [
        *tool_boxes(over + ASIDE, tool_rotation(0.0), 0.016), block_box(PLACE, 0.0)
    ]  # fmt: skip
    assert sketch(CAMERA, aside, ORANGE, _middle(), 30).visible == 1.0


def test_a_sketch_s_area_does_not_depend_on_how_finely_it_is_drawn():
    boxes = [block_box(PLACE, 0.2)]
    fine = sketch(CAMERA, boxes, ORANGE, _middle(), 20)
    coarse = sketch(CAMERA, boxes, ORANGE, _middle(), 130)
    assert coarse.area == pytest.approx(fine.area, rel=0.15)
    assert coarse.middle == pytest.approx(fine.middle, abs=0.3)


def test_a_quarter_turn_of_the_block_changes_nothing():
    corners = block_corners(PLACE, np.array([0.1, 0.1 + np.pi / 2]))
    first, second = (set(map(tuple, one.round(9))) for one in corners)
    assert first == second
    assert set(map(tuple, block_box(PLACE, 0.1).corners.round(9))) == first

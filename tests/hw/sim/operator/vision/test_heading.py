import math
from functools import partial

import numpy as np
import pytest

from hw.sim.operator.seeing import wrist_camera
from hw.sim.operator.vision.heading import HALF_TURN, fit_yaw
from hw.sim.operator.vision.solids import about_vertical, block_corners

pytestmark = pytest.mark.untimed

CAMERA = wrist_camera()
BELOW = np.array([0.0, 0.0, 0.10])  # of the TCP, in the tool's frame: z points down


def _draw(yaws, lying=False):
    corners = block_corners(BELOW, yaws, lying)
    return CAMERA.project(corners.reshape(-1, 3)).reshape(len(yaws), 8, 2)


@pytest.mark.parametrize("degrees", [-40, -20, -7, 0, 3, 15, 31, 44])
def test_the_yaw_is_read_off_the_outline(degrees):
    (outline,) = _draw(np.radians([degrees]))
    fitted = fit_yaw(outline, 0.3, _draw)
    off = (math.degrees(fitted.yaw) - degrees + 45) % 90 - 45
    assert abs(off) < 1.0
    assert math.radians(0.6) < math.hypot(fitted.sigma, fitted.lasting) < math.radians(5)


@pytest.mark.parametrize("degrees", [-80, -30, 10, 60])
def test_a_lying_block_is_told_from_a_standing_one_and_its_long_side_found(degrees):
    (outline,) = _draw(np.radians([degrees]), lying=True)
    fitted = fit_yaw(outline, 0.3, partial(_draw, lying=True), HALF_TURN)
    off = (math.degrees(fitted.yaw) - degrees + 90) % 180 - 90
    assert abs(off) < 1.0
    standing = fit_yaw(outline, 0.3, _draw)
    assert standing is None or standing.misfit_px > 2.0 * fitted.misfit_px + 0.2


def test_neither_place_nor_blur_of_the_outline_matter():
    (outline,) = _draw(np.radians([20]))
    away = outline - outline.mean(axis=0)
    grown = outline + 1.5 * away / np.linalg.norm(away, axis=1)[:, None] + (7.0, -4.0)
    assert math.degrees(fit_yaw(grown, 0.3, _draw).yaw) == pytest.approx(20, abs=3.0)


def test_rougher_edges_leave_more_doubt():
    (outline,) = _draw(np.radians([20]))
    assert fit_yaw(outline, 1.5, _draw).lasting > 1.5 * fit_yaw(outline, 0.3, _draw).lasting


def test_what_is_no_block_has_no_yaw():
    angles = np.linspace(0, 2 * np.pi, 40)
    long = np.column_stack((320 + 60 * np.cos(angles), 240 + 5 * np.sin(angles)))
    assert fit_yaw(long, 0.3, _draw) is None


def test_turning_about_the_vertical_is_a_rotation():
    assert about_vertical(0.3) @ about_vertical(-0.3) == pytest.approx(np.eye(3))

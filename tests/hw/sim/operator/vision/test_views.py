import numpy as np
import pytest

from hw.sim.operator.vision.views import fixed_cameras

pytestmark = pytest.mark.untimed

POINT = np.array([0.34, -0.08, 0.02])


@pytest.mark.parametrize("view", ["gt", "gs"])
def test_the_jacobian_is_the_projection_s_slope(view):
    camera, step = fixed_cameras()[view], 1e-6
    here = camera.project(POINT[None])[0]
    moved = camera.project(POINT + step * np.eye(3))
    slope = camera.jacobian(POINT)
    assert pytest.approx((moved - here) / step, rel=1e-3) == slope.T


@pytest.mark.parametrize("view", ["gt", "gs"])
def test_a_pixel_s_ray_meets_the_point_it_shows(view):
    camera = fixed_cameras()[view]
    pixel = camera.project(POINT[None])[0]
    assert camera.ray_at_height(pixel, POINT[2]) == pytest.approx(POINT, abs=1e-9)


def test_what_lies_on_the_axis_is_in_the_middle_of_the_image():
    camera = fixed_cameras()["gt"]
    ahead = camera.place + 0.5 * camera.axes[:, 2]
    assert camera.project(ahead[None])[0] == pytest.approx((319.5, 239.5))
    assert camera.depths(ahead[None]) == pytest.approx([0.5])

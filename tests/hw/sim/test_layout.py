import numpy as np
import pytest

from hw.sim.layout import FIXED_VIEWPOINTS, HEIGHT_PX, WIDTH_PX, draw_layout
from hw.sim.operator.vision.views import fixed_cameras

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize("view", FIXED_VIEWPOINTS)
def test_block_and_container_of_every_scene_are_in_the_image(view):
    camera = fixed_cameras()[view]
    for seed in range(200):
        layout = draw_layout(seed)
        places = [(layout.block.x, layout.block.y, 0.0)]
        places += [
            (layout.container.x + dx, layout.container.y + dy, 0.03)
            for dx in (-0.05, 0.05)
            for dy in (-0.05, 0.05)
        ]
        pixels = camera.project(np.array(places))
        assert (pixels > 4).all()
        assert (pixels < (WIDTH_PX - 5, HEIGHT_PX - 5)).all()


@pytest.mark.parametrize("view", FIXED_VIEWPOINTS)
def test_the_block_is_large_enough_to_be_worth_looking_at(view):
    camera = fixed_cameras()[view]
    edge = camera.project(np.array([(0.35, -0.006, 0.01), (0.35, 0.006, 0.01)]))
    assert np.linalg.norm(edge[1] - edge[0]) > 9.0

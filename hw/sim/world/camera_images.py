"""What the rig's cameras report, and when: the scene as drawn, with the sensors' noise."""

from __future__ import annotations

from hw.sim.layout import Layout
from hw.sim.world.scene import VIEWS
from hw.sim.world.scene_renderer import HEIGHT, WIDTH, SceneRenderer
from hw.sim.world.sensor_noise import SensorNoise
from tams_app.records import Image, Vector


class CameraImages:
    """Takes the images of all views; use it from one thread only, and close it there."""

    def __init__(self, layout: Layout, seed: int, noise_sigma: float) -> None:
        """`noise_sigma` [grey levels of 255]. SetupError without off-screen OpenGL."""
        self._renderer = SceneRenderer(layout)
        self._noises = {view: SensorNoise(seed, view, noise_sigma, HEIGHT, WIDTH) for view in VIEWS}

    def take(self, view: str, index: int, qpos: Vector) -> Image:
        """Image `index` of `view` with all joints at `qpos`: BGR, shape (480, 640, 3)."""
        return self._noises[view].apply(self._renderer.render(view, qpos), index)

    def close(self) -> None:
        """Give the graphics back; may be called twice."""
        self._renderer.close()


def stagger_ns(view: str, period_ns: int) -> int:
    """By how much the instants of `view` lie behind the first view's: the views take turns."""
    return VIEWS.index(view) * period_ns // len(VIEWS)

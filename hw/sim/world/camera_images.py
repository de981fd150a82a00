"""Images of the rig's cameras and their times: the scene as drawn, with their sensors' noise."""

from __future__ import annotations

import cv2
import numpy as np

from hw.sim.layout import Layout
from hw.sim.viewpoints import HEIGHT_PX, VIEWS, WIDTH_PX
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app.records import Image
from tams_app.vectors import Numbers

NOISE_SIGMA = 1.5  # grey levels of 255, as of the sensors in good light
_MARGIN_PX = 64  # the noise image is larger by this much each way, and shifted for each frame


class CameraImages:
    """Takes the images of all views; use it from one thread only, and close it there."""

    def __init__(self, layout: Layout, seed: int) -> None:
        """SetupError without off-screen OpenGL."""
        self._renderer = SceneRenderer(layout)
        self._noises = {view: SensorNoise(seed, view) for view in VIEWS}

    def take(self, view: str, index: int, qpos: Numbers) -> Image:
        """Image `index` of `view` with all joints at `qpos`: BGR, shape (480, 640, 3)."""
        return self._noises[view].apply(self._renderer.render(view, qpos), index)

    def close(self) -> None:
        """Release the graphics; may be called twice."""
        self._renderer.close()


class SensorNoise:
    """Gaussian noise of `NOISE_SIGMA` grey levels, the same for all colours of a pixel.

    Depends on `seed`, `view` and the frame's index only, so runs repeat. Cheap because it is drawn
    once and shifted for each frame.
    """

    def __init__(self, seed: int, view: str) -> None:
        self._entropy = [seed, *view.encode()]
        random = np.random.default_rng(self._entropy)
        size = (HEIGHT_PX + _MARGIN_PX, WIDTH_PX + _MARGIN_PX)
        noise = np.rint(NOISE_SIGMA * random.standard_normal(size)).astype(np.int16)
        self._brighter = _grey(np.maximum(noise, 0))
        self._darker = _grey(np.maximum(-noise, 0))

    def apply(self, image: Image, index: int) -> Image:
        """`image` (BGR) as the sensor reports it in frame `index`, changed in place."""
        height, width = image.shape[:2]
        random = np.random.default_rng([*self._entropy, index])
        top, left = random.integers(0, _MARGIN_PX, 2)
        window = np.s_[top : top + height, left : left + width]
        cv2.add(image, self._brighter[window], image)
        cv2.subtract(image, self._darker[window], image)
        return image


def stagger_ns(view: str, period_ns: int) -> int:
    """By how much the instants of `view` lie behind the first view's: the views take turns."""
    return VIEWS.index(view) * period_ns // len(VIEWS)


def _grey(values: np.ndarray[tuple[int, int], np.dtype[np.int16]]) -> Image:
    return np.repeat(values.astype(np.uint8)[..., None], 3, axis=2)

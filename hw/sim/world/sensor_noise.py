"""The noise of a camera's sensor: seeded, and cheap because it is drawn once and moved about."""

from __future__ import annotations

import cv2
import numpy as np

from tams_app.records import Image

_MARGIN = 64  # the noise image is larger by this much each way, and shifted for each frame


class SensorNoise:
    """Adds Gaussian noise of `sigma` grey levels, the same for all colours of a pixel.

    Depends on `seed`, `view` and the frame's index only, so runs repeat.
    """

    def __init__(self, seed: int, view: str, sigma: float, height: int, width: int) -> None:
        self._entropy = [seed, *view.encode()]
        random = np.random.default_rng(self._entropy)
        size = (height + _MARGIN, width + _MARGIN)
        noise = np.rint(sigma * random.standard_normal(size)).astype(np.int16)
        self._brighter = _grey(np.maximum(noise, 0))
        self._darker = _grey(np.maximum(-noise, 0))
        self._silent = sigma == 0

    def apply(self, image: Image, index: int) -> Image:
        """`image` (BGR) as the sensor reports it in frame `index`, changed in place."""
        if self._silent:
            return image
        height, width = image.shape[:2]
        random = np.random.default_rng([*self._entropy, index])
        top, left = random.integers(0, _MARGIN, 2)
        window = np.s_[top : top + height, left : left + width]
        cv2.add(image, self._brighter[window], image)
        cv2.subtract(image, self._darker[window], image)
        return image


def _grey(values: np.ndarray[tuple[int, int], np.dtype[np.int16]]) -> Image:
    return np.repeat(values.astype(np.uint8)[..., None], 3, axis=2)

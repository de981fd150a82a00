"""A textured scene that pans as a wrist camera's does: every frame differs, none is random."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from tams_app.records import Image

WIDTH, HEIGHT = 640, 480


def image(index: int) -> Image:
    """Image `index` of the sweep: BGR, shape (480, 640, 3)."""
    x = round(430 + 400 * np.sin(index / 38.0))
    y = round(360 + 330 * np.sin(index / 23.0))
    shown: Image = np.ascontiguousarray(_canvas()[y : y + HEIGHT, x : x + WIDTH])
    return shown


@cache
def _canvas() -> Image:
    random = np.random.default_rng(7)
    coarse = random.integers(0, 255, (40, 50, 3), dtype=np.uint8)
    fine = random.normal(0, 25, (300, 375, 3)).astype(np.float32)
    canvas = cv2.resize(coarse, (1500, 1200), interpolation=cv2.INTER_CUBIC) * 0.6 + 40
    canvas = canvas + cv2.resize(fine, (1500, 1200))
    return np.asarray(np.clip(canvas, 0, 255), np.uint8)

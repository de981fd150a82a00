"""Frames for video tests: a textured scene that pans, so that every frame differs."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from tams_app.records import Frame, Image

WIDTH, HEIGHT = 640, 480


@cache
def _canvas() -> Image:
    random = np.random.default_rng(7)
    coarse = random.integers(0, 255, (40, 50, 3), dtype=np.uint8)
    fine = random.normal(0, 25, (300, 375, 3)).astype(np.float32)
    canvas = cv2.resize(coarse, (1500, 1200), interpolation=cv2.INTER_CUBIC) * 0.6 + 40
    canvas = canvas + cv2.resize(fine, (1500, 1200))
    return np.clip(canvas, 0, 255).astype(np.uint8)


def image(index: int) -> Image:
    """The scene as a wrist camera sees it while it sweeps: shape (480, 640, 3), BGR."""
    x = round(430 + 400 * np.sin(index / 38.0))
    y = round(360 + 330 * np.sin(index / 23.0))
    return _canvas()[y : y + HEIGHT, x : x + WIDTH].copy()


def frame(index: int, view: str = "eih", capture_ns: int = 0) -> Frame:
    return Frame(view, index, capture_ns, image(index))

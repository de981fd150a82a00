"""How far the fingers are open, from the two green pads in the wrist camera's image."""

from __future__ import annotations

import numpy as np

from hw.sim.layout import FINGER_TRAVEL_M
from hw.sim.operator.vision.blobs import Window, find_blobs
from hw.sim.operator.vision.pinhole import Pinhole
from hw.sim.operator.vision.solids import GREEN, finger_boxes, sketch
from tams_app.records import Image

OPEN_M = 2.0 * FINGER_TRAVEL_M
_RADIUS_M = 0.032
_ALIKE = 0.5  # of two pads, the smaller has at least this part of the larger one's area
_CLOSED_PART = 1.4  # of one pad's area: both as one patch


class FingerGauge:
    """Reads the opening off the distance of the pads' middles; the camera rides on the tool."""

    def __init__(self, camera: Pinhole) -> None:
        """`camera` in the tool's frame."""
        pads = np.array([(0.0, 0.0, -0.007)])
        self._middle = camera.project(pads)[0]
        self._radius = camera.focal_px * _RADIUS_M / float(camera.depths(pads)[0])
        self._expected = [self._expect(camera, opening) for opening in (0.25 * OPEN_M, OPEN_M)]

    def measure(self, image: Image) -> float | None:
        """The opening [m]; None when the pads cannot be made out."""
        window = Window.about(image, self._middle, self._radius)
        area = self._expected[1][1]
        blobs = find_blobs(window, GREEN, area) if window is not None else []
        if not blobs or blobs[0].area < 0.4 * area:
            return None
        if len(blobs) == 1 or blobs[1].area < _ALIKE * blobs[0].area:
            return 0.0 if blobs[0].area > _CLOSED_PART * area else None
        apart = abs(float(blobs[0].middle[0] - blobs[1].middle[0]))
        (near_px, _), (wide_px, _) = self._expected
        opening = OPEN_M * (0.25 + 0.75 * (apart - near_px) / (wide_px - near_px))
        return float(np.clip(opening, 0.0, OPEN_M))

    def _expect(self, camera: Pinhole, opening: float) -> tuple[float, float]:
        """Distance of the pads' middles [px] and the area of one [px²] at `opening` [m]."""
        boxes = finger_boxes(opening)
        half = len(boxes) // 2
        left, right = (
            sketch(camera, side, GREEN, self._middle, self._radius)
            for side in (boxes[:half], boxes[half:])
        )
        return float(right.middle[0] - left.middle[0]), right.area

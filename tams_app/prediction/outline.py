"""An outline of where the gripper is now, over a late picture of a camera that stands still."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from tams_app.prediction.plane_warp import corners_of, mounted, projected, silhouette
from tams_app.records import Image, Lens, Pose, Solid

_CAUGHT_UP_PX = 3.0  # nearer than this to where the picture shows it there is nothing to tell
_LINE, _EDGE = 250, 20  # grey levels: light, with a dark edge that makes it visible on anything


class GripperOutline:
    """Draws the outline of `tool` as `lens`, which is mounted on the base, sees it."""

    def __init__(self, lens: Lens, tool: Iterable[Solid]) -> None:
        """`tool`: what moves with the flange, in its frame."""
        self._lens, self._tool = lens, tuple(tool)
        self._corners = np.concatenate([corners_of(solid) for solid in self._tool])

    def over(self, image: Image, then: Pose, now: Pose) -> Image | None:
        """`image` with the outline at `now`, base frame; None where it was within 3 pixels `then`.

        Grey or BGR; the image itself stays as it is.
        """
        was, is_now = (self._pixels(flange) for flange in (then, now))
        if len(was) == len(is_now) and np.abs(was - is_now).max(initial=0.0) <= _CAUGHT_UP_PX:
            return None
        placed = (
            Solid(solid.kind, mounted(now, solid.pose), solid.extent, solid.colour)
            for solid in self._tool
        )
        shape = silhouette(placed, self._lens)
        contours, _ = cv2.findContours(shape, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        drawn = image.copy()
        for grey, width in ((_EDGE, 3), (_LINE, 1)):
            cv2.drawContours(drawn, contours, -1, (grey,) * 3, width, cv2.LINE_AA)
        return drawn

    def _pixels(self, flange: Pose) -> np.ndarray:
        return projected(flange.position + flange.rotation.apply(self._corners), self._lens)

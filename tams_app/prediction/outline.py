"""An outline of where the gripper is now, over a late picture of a camera that stands still."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.prediction.plane_warp import corners_of, mounted, projected, silhouette
from tams_app.records import Image, Lens, Pose, Solid
from tams_app.vectors import ZERO, Floats3

_CAUGHT_UP_PX = 3.0  # nearer than this to where the picture shows it there is nothing to tell
_LED_PX = 6.0  # nearer than this to where it is now, where it is led is not marked
_CROSS_PX = 13
_LINE, _EDGE = 250, 20  # grey levels: light, with a dark edge that makes it visible on anything
_WIDTHS = ((_EDGE, 3), (_LINE, 1))


class GripperOutline:
    """Draws the outline of `tool` as `lens`, which is mounted on the base, sees it.

    And a cross where the hand leads its tip: that answers the hand at once, however far the arm is.
    """

    def __init__(self, lens: Lens, tool: Iterable[Solid], tip: Floats3 = ZERO) -> None:
        """`tool`: what moves with the flange, and `tip`, its TCP [m], in the flange's frame."""
        self._lens, self._tool, self._tip = lens, tuple(tool), np.array(tip)
        self._corners = np.concatenate([corners_of(solid) for solid in self._tool])

    def over(self, image: Image, then: Pose, now: Pose, commanded: Pose) -> Image | None:
        """`image` with the outline at `now` and the cross at `commanded`, base frame.

        Grey or BGR; the image itself stays as it is. No outline within 3 pixels of `then`, no cross
        within 6 of `now`; None where there is neither.
        """
        was, is_now = (self._pixels(flange, self._corners) for flange in (then, now))
        has_moved = len(was) != len(is_now) or _apart_px(was, is_now) > _CAUGHT_UP_PX
        here, there = (self._pixels(flange, self._tip[None]) for flange in (now, commanded))
        is_led = len(here) == len(there) == 1 and _apart_px(here, there) > _LED_PX
        if not (has_moved or is_led):
            return None
        drawn = image.copy()
        if has_moved:
            self._draw_outline(drawn, now)
        if is_led:
            x, y = np.rint(there[0]).astype(int).tolist()
            for grey, width in _WIDTHS:
                cv2.drawMarker(drawn, (x, y), (grey,) * 3, cv2.MARKER_CROSS, _CROSS_PX, width)
        return drawn

    def _draw_outline(self, image: Image, now: Pose) -> None:
        placed = (
            Solid(solid.kind, mounted(now, solid.pose), solid.extent, solid.colour)
            for solid in self._tool
        )
        shape = silhouette(placed, self._lens)
        contours, _ = cv2.findContours(shape, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for grey, width in _WIDTHS:
            cv2.drawContours(image, contours, -1, (grey,) * 3, width, cv2.LINE_AA)

    def _pixels(self, flange: Pose, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return projected(flange.position + flange.rotation.apply(points), self._lens)


def _apart_px(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """How far corresponding pixels are apart at most, along the rows or the columns."""
    return float(np.abs(one - other).max(initial=0.0))

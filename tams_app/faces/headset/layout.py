"""Places of all parts: within the one picture of all that is shown, and around the head; pure.

Angles are of OpenVR's axes: x right, y up, z backwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, degrees, radians, tan

import numpy as np
from numpy.typing import NDArray

from tams_app.config import HeadsetConfig
from tams_app.rotation import Rotation

DESIGN_WIDTH_PX = 640  # of a frame; sizes below are for it
HEADER_PX, BORDER_PX = 44, 12
PANEL_WIDTH_PX, PANEL_HEIGHT_PX = 1328, 336
_APART_PX = 4  # in the atlas, so that smoothing takes in nothing of a neighbour
_APART_DEG = 1.5
OTHERS_SHARE = 0.6  # of the primary view's width


@dataclass(frozen=True, slots=True)
class Crop:
    """A part of a picture [px], from its left and upper edge."""

    left: int
    top: int
    width: int
    height: int


class Atlas:
    """The picture of all that is shown: a cell for each view, side by side, and below the panel.

    A cell is the view's frame with a border around it and a header above.
    """

    def __init__(self, views: tuple[str, ...], width: int, height: int) -> None:
        """`width`, `height`: of a frame [px]."""
        self.scale = width / DESIGN_WIDTH_PX
        header, border = round(HEADER_PX * self.scale), round(BORDER_PX * self.scale)
        self.frame = Crop(border, header, width, height)  # within a cell
        cell_width, cell_height = width + 2 * border, header + height + border
        step = cell_width + _APART_PX
        self.cells = {
            view: Crop(number * step, 0, cell_width, cell_height)
            for number, view in enumerate(views)
        }
        self.panel = Crop(0, cell_height + _APART_PX, PANEL_WIDTH_PX, PANEL_HEIGHT_PX)
        self.width = max(len(views) * step, PANEL_WIDTH_PX)
        self.height = self.panel.top + PANEL_HEIGHT_PX


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a part of the atlas around the head.

    pose: from its own axes (x right, y up, z towards the eyes) to those of the head that looks
    straight on, shape (4, 4) [m]. width_m: of the picture.
    """

    pose: NDArray[np.float64]
    width_m: float


def view_places(config: HeadsetConfig, count: int) -> list[Place]:
    """The first one in front, the others beside it in turn: right, left, further right..."""
    wide, narrow = config.width_deg, OTHERS_SHARE * config.width_deg
    places = [_place(config, 0.0, config.elevation_deg, wide)]
    for number in range(count - 1):
        column, side = divmod(number, 2)
        right_deg = (wide + narrow) / 2 + _APART_DEG + column * (narrow + _APART_DEG)
        places.append(
            _place(config, -right_deg if side else right_deg, config.elevation_deg, narrow)
        )
    return places


def panel_place(config: HeadsetConfig, atlas: Atlas) -> Place:
    """Below the primary view, as wide as that."""
    cell = next(iter(atlas.cells.values()))
    half = [_half_height_deg(config.width_deg, part) for part in (cell, atlas.panel)]
    elevation_deg = config.elevation_deg - half[0] - _APART_DEG - half[1]
    return _place(config, 0.0, elevation_deg, config.width_deg)


def _half_height_deg(width_deg: float, part: Crop) -> float:
    return degrees(atan(tan(radians(width_deg / 2)) * part.height / part.width))


def _place(config: HeadsetConfig, right_deg: float, up_deg: float, width_deg: float) -> Place:
    """A picture at the distance, turned towards the eyes."""
    raised = Rotation.from_rotvec((radians(up_deg), 0.0, 0.0))
    turn = raised.turned((0.0, radians(-right_deg), 0.0)).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = turn @ (0.0, 0.0, -config.distance_m)
    return Place(pose, 2 * config.distance_m * tan(radians(width_deg / 2)))

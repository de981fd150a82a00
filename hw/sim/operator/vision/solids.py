"""The things of the task as boxes, and how they hide one another in an image.

Operators know what block, gripper and container look like; of a thing half hidden behind another
they do not take the middle of the visible part for the middle of the thing. `sketch` is that
knowledge: a coarse drawing of the boxes, far ones first.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from hw.sim.layout import (
    BLOCK_EDGE_M,
    BLOCK_HEIGHT_M,
    CLIP_HALF,
    CONTAINER_HEIGHT_M,
    CONTAINER_INNER_M,
    CONTAINER_WALL_M,
    HOUSING,
    PAD_HALF,
    PLATE,
    TCP_OFFSET_M,
)
from hw.sim.operator.vision.views import Matrix, Pinhole
from tams_app.records import Image, Vector

DARK, GREEN, ORANGE, BLUE = 1, 2, 3, 4
_FINEST = 3  # parts of a pixel in a sketch, fewer in a large one
_SKETCH_EDGE = 240  # about as large as a sketch gets
_SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_TOOL_DOWN = np.diag((1.0, -1.0, -1.0))

# Places and half sizes of the fingers' parts in the flange's frame [m].
_PAD_CENTRE_Z = 0.075
_CLIP_BESIDE_PAD = 0.0032
_STEM_HALF = (0.0055, 0.0030, 0.0055)  # as far as the pad does not cover it
_STEM_BESIDE_PAD = 0.0030
_STEM_Z = 0.0575


@dataclass(frozen=True, slots=True)
class Box:
    """Corners, shape (8, 3) [m], and the colour it is drawn in."""

    corners: Matrix
    colour: int


def tool_rotation(yaw: float) -> Matrix:
    """The tool's axes in the base frame when it points down, turned by `yaw` [rad]."""
    return about_vertical(yaw) @ _TOOL_DOWN


def tilted(tilt: Vector) -> Matrix:
    """The rotation by a small `tilt` [rad] about the base frame's x and y."""
    x, y = float(tilt[0]), float(tilt[1])
    return np.array([[1.0, 0.0, y], [0.0, 1.0, -x], [-y, x, 1.0]])


def about_vertical(yaw: float) -> Matrix:
    """The rotation by `yaw` [rad] about the base frame's z."""
    sine, cosine = float(np.sin(yaw)), float(np.cos(yaw))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def block_box(centre: Vector, yaw: float, lying: bool = False) -> Box:
    """The block, upright on its square end or lying with its long side along `yaw` [rad]."""
    return Box(block_corners(centre, np.array([yaw]), lying)[0], ORANGE)


def block_corners(centre: Vector, yaws: Vector, lying: bool = False) -> Matrix:
    """Corners [m] of the block at each yaw [rad], shape (yaws, 8, 3)."""
    edge, length = BLOCK_EDGE_M / 2, BLOCK_HEIGHT_M / 2
    half = np.array((length, edge, edge) if lying else (edge, edge, length))
    x, y, z = (_SIGNS * half).T
    sine, cosine = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
    turned = (cosine * x - sine * y, sine * x + cosine * y, np.broadcast_to(z, (len(yaws), 8)))
    return np.asarray(centre + np.stack(turned, axis=2))


def container_box(x: float, y: float) -> Box:
    """The container as a solid, as its outline shows it."""
    outer = CONTAINER_INNER_M / 2 + CONTAINER_WALL_M
    half = np.array((outer, outer, CONTAINER_HEIGHT_M / 2))
    return Box(np.array((x, y, half[2])) + _SIGNS * half, BLUE)


def finger_boxes(opening_m: float) -> list[Box]:
    """The green pads with what is dark about them, in the tool's frame (origin: TCP)."""
    boxes = []
    for side in (-1.0, 1.0):
        pad = side * (opening_m / 2 + PAD_HALF[1])
        boxes.append(_tool_box((0.0, pad, _PAD_CENTRE_Z), PAD_HALF, GREEN))
        clip = pad + side * _CLIP_BESIDE_PAD
        boxes.append(_tool_box((0.0, clip, _PAD_CENTRE_Z), CLIP_HALF, DARK))
        boxes.append(_tool_box((0.0, pad + side * _STEM_BESIDE_PAD, _STEM_Z), _STEM_HALF, DARK))
    return boxes


def tool_boxes(tcp: Vector, axes: Matrix, opening_m: float) -> list[Box]:
    """The gripper in the base frame; `axes`: the tool's, as columns."""
    parts = [_tool_box(*HOUSING, DARK), _tool_box(*PLATE, DARK), *finger_boxes(opening_m)]
    return [Box(tcp + part.corners @ axes.T, part.colour) for part in parts]


def _tool_box(
    centre: tuple[float, float, float], half: tuple[float, float, float], colour: int
) -> Box:
    middle = np.array(centre) - (0.0, 0.0, TCP_OFFSET_M)
    return Box(middle + _SIGNS * np.array(half), colour)


@dataclass(frozen=True, slots=True)
class VisiblePart:
    """The visible part of a colour in a sketch: middle [px], area and full area [px²]."""

    middle: Vector
    area: float
    full_area: float

    @property
    def visible(self) -> float:
        """The part of it that nothing hides, 0..1."""
        return self.area / self.full_area if self.full_area > 0.0 else 0.0


def sketch(
    camera: Pinhole, boxes: Sequence[Box], colour: int, middle: Vector, radius_px: float
) -> VisiblePart:
    """The visible part of `colour` within `radius_px` of `middle` [px]."""
    corner = middle - radius_px
    scale = max(1, min(_FINEST, int(_SKETCH_EDGE / (2 * radius_px))))
    edge = max(8, int(2 * radius_px * scale))
    drawing: Image = np.zeros((edge, edge), np.uint8)
    alone: Image = np.zeros((edge, edge), np.uint8)
    corners = np.concatenate([box.corners for box in boxes])
    pixels = (camera.project(corners) - corner) * scale
    outlines = np.round(pixels).astype(np.int32).reshape(-1, 8, 2)
    hulls = [cv2.convexHull(outline) for outline in outlines]
    depths = camera.depths(corners.reshape(-1, 8, 3).sum(axis=1) / 8)
    for place in np.argsort(-depths, kind="stable"):
        cv2.fillConvexPoly(drawing, hulls[place], boxes[place].colour)
        if boxes[place].colour == colour:
            cv2.fillConvexPoly(alone, hulls[place], 1)
    moments = cv2.moments((drawing == colour).view(np.uint8))  # of ones and zeros
    area = moments["m00"]
    found = middle
    if area > 0.0:
        found = corner + np.array((moments["m10"], moments["m01"])) / area / scale
    return VisiblePart(found, area / scale**2, cv2.countNonZero(alone) / scale**2)

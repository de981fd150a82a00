"""The scene of a trial as one MuJoCo model: `rig.xml`, the trial's layout, cameras and textures."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hw.sim.layout import (
    BLOCK_HEIGHT_M,
    BLOCK_MARKER,
    CONTAINER_MARKER,
    FIXED_VIEWPOINTS,
    GRIPPER_MARKER,
    WRIST_VIEWPOINT,
    FixedViewpoint,
    Layout,
    WristViewpoint,
)
from hw.sim.world import textures
from tams_app.records import Image

_FILE = Path(__file__).with_name("rig.xml")
_TEXTURE_SEED = 0x7A3C
_MAT_M = (0.42, 0.60)  # along x, along y

CONTAINER_PAINT = (26, 82, 176)
BLOCK_DARK, BLOCK_BRIGHT = (150, 22, 12), (255, 150, 40)


# What paints the textures, given a random generator, height and width [px]; of a cube each face.
_PAINTERS: dict[str, Callable[[np.random.Generator, int, int], Image]] = {
    "table": textures.wood,
    "mat": partial(textures.work_mat, size_m=_MAT_M),
    "wall": textures.brick,
    "floor": textures.concrete,
    "poster": textures.label,
    "sheet": textures.label,
    "housing": textures.brushed,
    "arm_print": partial(textures.label, paper=(226, 228, 230), ink=(60, 62, 70)),
    "gripper_marker": partial(
        textures.marker, identity=GRIPPER_MARKER, dark=textures.INK, bright=textures.WHITE
    ),
    "block": partial(textures.marker, identity=BLOCK_MARKER, dark=BLOCK_DARK, bright=BLOCK_BRIGHT),
    "bin_wall": partial(textures.panel, paint=CONTAINER_PAINT),
    "bin_floor": partial(
        textures.marker,
        identity=CONTAINER_MARKER,
        dark=(14, 40, 110),
        bright=(120, 190, 250),
        quiet_cells=3,
    ),
    "carton": textures.card,
    "can": partial(textures.label, paper=(188, 60, 132), ink=(250, 240, 246)),
    "jar": partial(textures.label, paper=(236, 232, 220), ink=(64, 40, 92)),
    "tin": partial(textures.label, paper=(58, 56, 62), ink=(230, 206, 120)),
}


def build_model(layout: Layout, *, textured: bool) -> mujoco.MjModel:
    """The compiled scene of `layout`; physics needs no textures, frames do."""
    spec = mujoco.MjSpec.from_file(str(_FILE))
    heights = {"block": BLOCK_HEIGHT_M / 2, "container": 0.0}
    for name, place in (("block", layout.block), ("container", layout.container)):
        body = spec.body(name)
        body.pos = (place.x, place.y, heights[name])
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_EULER
        body.alt.euler = (0.0, 0.0, place.yaw)
    for view, viewpoint in FIXED_VIEWPOINTS.items():
        _add_camera(spec.worldbody, view, viewpoint)
    _add_camera(spec.body("link6"), "eih", WRIST_VIEWPOINT)
    spec.compiler.discardvisual = not textured
    model = spec.compile()
    if textured:
        _paint(model)
    return model


def _add_camera(body: Any, view: str, viewpoint: FixedViewpoint | WristViewpoint) -> None:
    camera = body.add_camera(name=view, pos=viewpoint.place, fovy=viewpoint.fovy_deg)
    right, down, _ = viewpoint.axes().T
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [round(float(part), 6) for part in (*right, *-down)]


def _paint(model: mujoco.MjModel) -> None:
    for name in _PAINTERS:
        texture = model.texture(name)
        pixels = _painted(name, texture.id, int(texture.height[0]), int(texture.width[0]))
        start = int(model.tex_adr[texture.id])
        model.tex_data[start : start + pixels.size] = pixels


@cache
def _painted(name: str, number: int, height: int, width: int) -> Image:
    """Pixels of a texture, shape (n,): the same in every scene."""
    random = np.random.default_rng([_TEXTURE_SEED, number])
    faces = 6 if height == 6 * width else 1  # of a cube, below one another
    painted = [_PAINTERS[name](random, height // faces, width) for _ in range(faces)]
    return np.concatenate(painted).ravel()

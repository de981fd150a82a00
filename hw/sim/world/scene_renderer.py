"""Images of the simulated world from its three cameras, off screen, on the CPU.

A fixed camera's view of what never moves is drawn once, colour and depth; each image then needs
the moving things only, laid over it where they are nearer (FINDINGS 9). Without shadows and
reflections that is pixel-identical to drawing everything.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import Layout
from hw.sim.viewpoints import FIXED_VIEWPOINTS, HEIGHT_PX, VIEWS, WIDTH_PX
from hw.sim.world.scene import build_model
from tams_app.errors import SetupError
from tams_app.records import Image, Vector

_MAX_GEOMS = 200
_MOVING_GROUP = 1  # the geoms that move, in rig.xml
_OFF = (
    mujoco.mjtRndFlag.mjRND_SHADOW,
    mujoco.mjtRndFlag.mjRND_REFLECTION,
    mujoco.mjtRndFlag.mjRND_HAZE,
)


@dataclass(frozen=True, slots=True)
class _Background:
    """What a fixed camera sees of the things that never move: RGB and depth, bottom row first."""

    colour: Image
    depth: NDArray[np.float32]


class SceneRenderer:
    """Renders the scene of `layout`; use it from one thread only, and close it there.

    SetupError when the machine has no off-screen OpenGL.
    """

    def __init__(self, layout: Layout) -> None:
        self._context = _open_context()
        self._context.make_current()
        self._model = build_model(layout, textured=True)
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._whole = mujoco.MjrRect(0, 0, WIDTH_PX, HEIGHT_PX)
        for flag in _OFF:
            self._scene.flags[flag] = 0
        self._cameras = {view: self._camera(view) for view in VIEWS}
        self._colour = np.empty((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
        self._depth = np.empty((HEIGHT_PX, WIDTH_PX), np.float32)
        self._pose(self._model.qpos0)
        self._backgrounds = {view: self._background(view) for view in FIXED_VIEWPOINTS}

    def render(self, view: str, qpos: Vector) -> Image:
        """The image of `view` when all joints are at `qpos`: BGR, shape (480, 640, 3)."""
        self._pose(qpos)
        background = self._backgrounds.get(view)
        if background is None:
            self._draw(view, mujoco.MjvOption())
            return _upright(self._colour)
        self._draw(view, _only(moving=True))
        nearer = cv2.compare(self._depth, background.depth, cv2.CMP_GT)
        image = background.colour.copy()
        cv2.copyTo(self._colour, nearer, image)
        return _upright(image)

    def close(self) -> None:
        """Give the context back; may be called twice."""
        if self._drawing is not None:
            self._drawing.free()
            self._drawing = None
            self._context.free()

    def _pose(self, qpos: Vector) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def _background(self, view: str) -> _Background:
        self._draw(view, _only(moving=False))
        return _Background(self._colour.copy(), self._depth.copy())

    def _draw(self, view: str, option: mujoco.MjvOption) -> None:
        """Draw into `_colour` and `_depth`; larger depth is nearer."""
        mujoco.mjv_updateScene(
            self._model, self._data, option, None, self._cameras[view],
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        mujoco.mjr_render(self._whole, self._scene, self._drawing)
        depth = self._depth if view in FIXED_VIEWPOINTS else None
        mujoco.mjr_readPixels(self._colour, depth, self._whole, self._drawing)

    def _camera(self, view: str) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = self._model.camera(view).id
        return camera


def _only(*, moving: bool) -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[_MOVING_GROUP if moving else 0] = 1
    return option


def _upright(image: Image) -> Image:
    """OpenGL's RGB with the bottom row first as BGR with the top row first, a new array."""
    return np.asarray(cv2.cvtColor(cv2.flip(image, 0), cv2.COLOR_RGB2BGR), np.uint8)


def _open_context() -> Any:
    """An off-screen OpenGL context: EGL, or else OSMesa; SetupError when there is neither."""
    # Mesa's software rasteriser in the calling thread: no slower here, no threads to schedule.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    reasons = []
    for name in ("egl", "osmesa"):
        try:
            return import_module(f"mujoco.{name}").GLContext(WIDTH_PX, HEIGHT_PX)
        except (ImportError, AttributeError, RuntimeError) as error:
            reasons.append(f"{name}: {error}")
    raise SetupError(
        "the simulated cameras need off-screen OpenGL; install libegl1 and libgl1-mesa-dri "
        f"({'; '.join(reasons)})"
    )

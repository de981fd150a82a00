"""Images of the simulated world from its three cameras, off screen, on the CPU, with their noise.

Only what a camera can see is drawn (`Visibility`). A fixed camera's view of what never moves is
drawn once, colour and depth; each image then needs the moving things only, read back where they may
be and laid over it where they are nearer (FINDINGS 9). Without shadows and reflections that is
pixel-identical to drawing everything.
"""

from __future__ import annotations

import ctypes
import math
import os
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import FIXED_VIEWPOINTS, HEIGHT_PX, VIEWS, WIDTH_PX, Layout
from hw.sim.world.scene import build_model
from tams_app.errors import SetupError
from tams_app.records import Image
from tams_app.vectors import Numbers

_MAX_GEOMS = 200
_MOVING_GROUP = 1  # the geoms that move, in rig.xml
_SHOWN, _HIDDEN = 0, 5  # groups that MuJoCo draws and leaves out
_OFF = (
    mujoco.mjtRndFlag.mjRND_SHADOW,
    mujoco.mjtRndFlag.mjRND_REFLECTION,
    mujoco.mjtRndFlag.mjRND_HAZE,
)
_TOP_ROW_FIRST = "GL_MESA_pack_invert"  # Mesa alone can read images back that way
NOISE_SIGMA = 1.5  # grey levels of 255, as of the sensors in good light
_MARGIN_PX = 64  # the noise image is larger by this much each way, and shifted for each frame


_SLABS = ("mat", "table")  # boxes along the axes of the world, the upper one first
_WIDER = 1.001  # field of view searched / that of the lens
_MARGIN_M = 0.001
_BELOW_M = 0.0005  # a slab's top: what is further down is hidden; the table is 1.5 mm below the mat
_LEAST_HEIGHT_M = 0.02  # above a slab: nearer, the near plane might cut it
_LEAST_SLOPE = 0.01  # of a ray that meets a slab
_EDGE_PX = 2  # by which a rectangle is larger than what it holds
_FACES = np.concatenate((np.eye(3), -np.eye(3)))  # of a box along the axes, inwards
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))

Rows = NDArray[np.float64]
Geoms = NDArray[np.bool_]


class CameraImages:
    """Takes the images of all views; use it from one thread only, and close it there."""

    def __init__(self, layout: Layout, seed: int) -> None:
        """SetupError without off-screen OpenGL."""
        self._renderer = SceneRenderer(layout)
        self._noises = {view: SensorNoise(seed, view) for view in VIEWS}

    def take(self, view: str, index: int, qpos: Numbers) -> Image:
        """Image `index` of `view` with all joints at `qpos`: BGR, shape (480, 640, 3)."""
        return self._noises[view].apply(self._renderer.render(view, qpos), index)

    def close(self) -> None:
        """Release the graphics; may be called twice."""
        self._renderer.close()


class SensorNoise:
    """Gaussian noise of `NOISE_SIGMA` grey levels, the same for all colours of a pixel.

    Depends on `seed`, `view` and the frame's index only, so runs repeat. Cheap because it is drawn
    once and shifted for each frame.
    """

    def __init__(self, seed: int, view: str) -> None:
        self._entropy = [seed, *view.encode()]
        random = np.random.default_rng(self._entropy)
        size = (HEIGHT_PX + _MARGIN_PX, WIDTH_PX + _MARGIN_PX)
        noise = np.rint(NOISE_SIGMA * random.standard_normal(size)).astype(np.int16)
        self._brighter = _grey(np.maximum(noise, 0))
        self._darker = _grey(np.maximum(-noise, 0))

    def apply(self, image: Image, index: int) -> Image:
        """`image` (BGR) as the sensor reports it in frame `index`, changed in place."""
        height, width = image.shape[:2]
        random = np.random.default_rng([*self._entropy, index])
        top, left = random.integers(0, _MARGIN_PX, 2)
        window = np.s_[top : top + height, left : left + width]
        cv2.add(image, self._brighter[window], image)
        cv2.subtract(image, self._darker[window], image)
        return image


def stagger_ns(view: str, period_ns: int) -> int:
    """By how much the instants of `view` lie behind the first view's: the views take turns."""
    return VIEWS.index(view) * period_ns // len(VIEWS)


def _grey(values: np.ndarray[tuple[int, int], np.dtype[np.int16]]) -> Image:
    return np.repeat(values.astype(np.uint8)[..., None], 3, axis=2)


@dataclass(frozen=True, slots=True)
class _Background:
    """A fixed camera's image of what never moves: BGR, and how near it is."""

    colour: Image
    depth: NDArray[np.float32]


class Visibility:
    """The parts visible to the cameras of `model` in the pose at `update`, decided without drawing.

    A geom that lies wholly beyond a plane which bounds the camera's view adds no pixel to the
    image, nor does one below a slab that fills the image. Bounding boxes decide, so some geoms are
    drawn for nothing and none is missing. Geoms are arrays of flags, shape (ngeom,); cameras are
    their numbers in the model.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._centres = data.geom_xpos
        self._axes = data.geom_xmat.reshape(-1, 3, 3)
        self._places, self._turns = data.cam_xpos, data.cam_xmat.reshape(-1, 3, 3)
        self._sizes = model.geom_aabb[:, 3:, None].copy()
        planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._sizes[planes, :, 0] = model.geom_size[planes] * (1, 1, 0)
        self._slabs = [model.geom(name).id for name in _SLABS]
        self._lenses = [_lens(float(fovy)) for fovy in np.radians(model.cam_fovy)]
        self.update()

    def update(self) -> None:
        """Take in the pose: boxes around the geoms, along the axes of the world."""
        self._halves: Rows = (np.abs(self._axes) @ self._sizes)[:, :, 0]

    def seen(self, camera: int) -> Geoms:
        """The geoms that may be in the image of `camera`."""
        place, turn = self._places[camera], self._turns[camera]
        right, up = self._lenses[camera]
        inwards = np.array([(-1, 0, -right), (1, 0, -right), (0, -1, -up), (0, 1, -up), (0, 0, -1)])
        normals = inwards @ turn.T
        least = normals @ place - _MARGIN_M
        above = self._above_slab(camera)
        if above is not None:
            normals, least = np.concatenate((normals, _FACES)), np.concatenate((least, above))
        reach = self._centres @ normals.T + self._halves @ np.abs(normals.T)
        seen: Geoms = (reach > least).all(axis=1)
        return seen

    def rectangle(self, camera: int, geoms: Geoms) -> tuple[int, int, int, int]:
        """Left, bottom, width and height [px] of all that `geoms` can cover of an image."""
        corners = self._centres[geoms, None] + _CORNERS * self._halves[geoms, None]
        away = corners.reshape(-1, 3) - self._places[camera]
        right, up, back = (away @ self._turns[camera]).T
        if not len(back) or back.max() > -_MARGIN_M:
            return 0, 0, WIDTH_PX, HEIGHT_PX
        px = -_WIDER * HEIGHT_PX / 2 / self._lenses[camera][1] / back
        left, width = _span(right * px, WIDTH_PX)
        bottom, height = _span(up * px, HEIGHT_PX)
        return left, bottom, width, height

    def _above_slab(self, camera: int) -> Rows | None:
        """Bounds that each of `_FACES` must reach to be seen by `camera`; None: no slab hides it.

        It is the box around the camera and what it sees of a slab that fills its image.
        """
        x, y, z = self._places[camera].tolist()
        rays = (self._turns[camera] @ _corners(*self._lenses[camera])).T.tolist()
        if max(ray[2] for ray in rays) > -_LEAST_SLOPE:
            return None
        for slab in self._slabs:
            (centre_x, centre_y, centre_z), (half_x, half_y, half_z) = (
                rows[slab].tolist() for rows in (self._centres, self._halves)
            )
            height = z - (centre_z + half_z)
            xs = [x - ray[0] / ray[2] * height for ray in rays]
            ys = [y - ray[1] / ray[2] * height for ray in rays]
            if (
                height > _LEAST_HEIGHT_M
                and max(abs(at - centre_x) for at in xs) < half_x - _MARGIN_M
                and max(abs(at - centre_y) for at in ys) < half_y - _MARGIN_M
            ):
                lower = (min(x, *xs) - _MARGIN_M, min(y, *ys) - _MARGIN_M, z - height - _BELOW_M)
                return np.array([*lower, -max(x, *xs) - _MARGIN_M, -max(y, *ys) - _MARGIN_M, -z])
        return None


def _lens(fovy_rad: float) -> tuple[float, float]:
    """Tangents of half the horizontal and vertical field of view, a little widened."""
    up = _WIDER * math.tan(fovy_rad / 2)
    return up * WIDTH_PX / HEIGHT_PX, up


def _corners(right: float, up: float) -> Rows:
    """Rays through the image's corners in the camera's frame (right, up, backward), as columns."""
    return np.array([(right, right, -right, -right), (up, -up, up, -up), (-1, -1, -1, -1)])


def _span(places_px: Rows, size: int) -> tuple[int, int]:
    """First pixel and number of pixels, of `size`, that `places_px` from the centre span."""
    first = max(0, math.floor(places_px.min() + size / 2) - _EDGE_PX)
    last = min(size, math.ceil(places_px.max() + size / 2) + _EDGE_PX)
    return first, max(0, last - first)


class SceneRenderer:
    """Renders the scene of `layout`; use it from one thread only, and close it there.

    SetupError when the machine has no off-screen OpenGL.
    """

    def __init__(self, layout: Layout) -> None:
        self._context = _open_context()
        self._context.make_current()
        self._gl = import_module("OpenGL.raw.GL.VERSION.GL_1_0")
        self._model = build_model(layout, textured=True)
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        _lighten(self._drawing, self._model.tex_type)
        self._upside_down = not _reads_top_row_first()
        self._whole = mujoco.MjrRect(0, 0, WIDTH_PX, HEIGHT_PX)
        for flag in _OFF:
            self._scene.flags[flag] = 0
        self._option = mujoco.MjvOption()
        self._cameras = {view: self._camera(view) for view in VIEWS}
        self._visibility = Visibility(self._model, self._data)
        self._moving = self._model.geom_group == _MOVING_GROUP
        self._colour = np.empty(HEIGHT_PX * WIDTH_PX * 4, np.uint8)
        self._depth = np.empty(HEIGHT_PX * WIDTH_PX, np.float32)
        self._pose(self._model.qpos0)
        self._backgrounds = {view: self._background(view) for view in FIXED_VIEWPOINTS}

    def render(self, view: str, qpos: Numbers) -> Image:
        """The image of `view` when all joints are at `qpos`: BGR, shape (480, 640, 3)."""
        self._pose(qpos)
        camera = self._cameras[view]
        seen = self._visibility.seen(camera.fixedcamid)
        background = self._backgrounds.get(view)
        if background is None:
            self._draw(camera, seen)
            return self._read_colour(self._whole)
        seen &= self._moving
        image = background.colour.copy()
        rectangle = mujoco.MjrRect(*self._visibility.rectangle(camera.fixedcamid, seen))
        if rectangle.width and rectangle.height:
            self._draw(camera, seen)
            left, top = rectangle.left, HEIGHT_PX - rectangle.bottom - rectangle.height
            place = np.s_[top : top + rectangle.height, left : left + rectangle.width]
            nearer = cv2.compare(self._read_depth(rectangle), background.depth[place], cv2.CMP_GT)
            cv2.copyTo(self._read_colour(rectangle), nearer, image[place])
        return image

    def close(self) -> None:
        """Give the context back; may be called twice."""
        if self._drawing is not None:
            self._drawing.free()
            self._drawing = None
            self._context.free()

    def _pose(self, qpos: Numbers) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._visibility.update()

    def _background(self, view: str) -> _Background:
        self._draw(self._cameras[view], ~self._moving)
        return _Background(self._read_colour(self._whole), self._read_depth(self._whole).copy())

    def _draw(self, camera: mujoco.MjvCamera, geoms: NDArray[np.bool_]) -> None:
        self._model.geom_group[:] = np.where(geoms, _SHOWN, _HIDDEN)
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, camera,
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        mujoco.mjr_render(self._whole, self._scene, self._drawing)

    def _read_colour(self, rectangle: mujoco.MjrRect) -> Image:
        """Read what was drawn there: BGR, a new array."""
        height, width = rectangle.height, rectangle.width
        # not by mjr_readPixels, whose RGB Mesa converts pixel by pixel; RGBA it copies
        self._gl.glReadPixels(
            rectangle.left, rectangle.bottom, width, height,
            self._gl.GL_RGBA, self._gl.GL_UNSIGNED_BYTE,
            self._colour.ctypes.data_as(ctypes.c_void_p),
        )  # fmt: skip
        colour = self._colour[: height * width * 4].reshape(height, width, 4)
        image = cv2.cvtColor(colour, cv2.COLOR_RGBA2BGR)
        return np.asarray(cv2.flip(image, 0) if self._upside_down else image, np.uint8)

    def _read_depth(self, rectangle: mujoco.MjrRect) -> NDArray[np.float32]:
        """Read how near it is, larger is nearer; valid until the next reading."""
        height, width = rectangle.height, rectangle.width
        depth = self._depth[: height * width].reshape(height, width)
        mujoco.mjr_readPixels(None, depth, rectangle, self._drawing)
        return np.asarray(cv2.flip(depth, 0), np.float32) if self._upside_down else depth

    def _camera(self, view: str) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = self._model.camera(view).id
        return camera


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


def _lighten(drawing: mujoco.MjrContext, texture_kinds: NDArray[np.int32]) -> None:
    """Set what MuJoCo leaves dearer than these images need; the OpenGL context is current."""
    gl = import_module("OpenGL.GL")
    # Depth without the stencil, which nothing here draws with: half the memory to clear and test.
    depth = gl.glGenRenderbuffers(1)
    gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, drawing.offFBO)
    gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, depth)
    gl.glRenderbufferStorage(gl.GL_RENDERBUFFER, gl.GL_DEPTH_COMPONENT32F, WIDTH_PX, HEIGHT_PX)
    for attachment, buffer in ((gl.GL_STENCIL_ATTACHMENT, 0), (gl.GL_DEPTH_ATTACHMENT, depth)):
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, attachment, gl.GL_RENDERBUFFER, buffer)
    # The nearer one of a texture's mipmap levels, not a mixture of two (FINDINGS 9).
    targets = {
        mujoco.mjtTexture.mjTEXTURE_2D: gl.GL_TEXTURE_2D,
        mujoco.mjtTexture.mjTEXTURE_CUBE: gl.GL_TEXTURE_CUBE_MAP,
    }
    for kind, texture in zip(texture_kinds, drawing.texture, strict=False):
        target = targets[mujoco.mjtTexture(kind)]
        gl.glBindTexture(target, texture)
        gl.glTexParameteri(target, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR_MIPMAP_NEAREST)


def _reads_top_row_first() -> bool:
    """Let what is read have the top row first, where the driver can; whether it does."""
    gl = import_module("OpenGL.GL")
    if _TOP_ROW_FIRST not in gl.glGetString(gl.GL_EXTENSIONS).decode().split():
        return False
    gl.glPixelStorei(import_module("OpenGL.GL.MESA.pack_invert").GL_PACK_INVERT_MESA, True)
    return True

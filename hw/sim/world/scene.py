"""The scene of a trial as one MuJoCo model: `rig.xml`, the trial's layout, cameras and textures.

The textures exist so that the encoder meets the detail of a real laboratory, and so that block,
container, gripper and mat carry ArUco markers (dictionary 4x4_50) and hues of their own that vision
can find. Each painter takes a seeded generator and returns an RGB image, uint8, shape
(height, width, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import (
    BLOCK_HEIGHT_M,
    BLOCK_MARKER,
    CONTAINER_MARKER,
    FIXED_VIEWPOINTS,
    GRIPPER_MARKER,
    WRIST_VIEWPOINT,
    Layout,
    Viewpoint,
)
from tams_app.records import Image

_FILE = Path(__file__).with_name("rig.xml")
_TEXTURE_SEED = 0x7A3C
_MAT_M = (0.42, 0.60)  # along x, along y

CONTAINER_PAINT = (26, 82, 176)
BLOCK_DARK, BLOCK_BRIGHT = (150, 22, 12), (255, 150, 40)

Field: TypeAlias = NDArray[np.floating]
Colour: TypeAlias = tuple[int, int, int]

WHITE: Colour = (244, 243, 238)
INK: Colour = (28, 28, 32)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_WORDS = (
    "LOT", "REV", "SAMPLE", "FRAGILE", "LAB", "BENCH", "M3x12", "TYPE", "NET", "THIS SIDE UP",
    "CAL", "UNIT", "STORE DRY", "QTY", "BATCH", "PASS",
)  # fmt: skip


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


def _add_camera(body: Any, view: str, viewpoint: Viewpoint) -> None:
    camera = body.add_camera(name=view, pos=viewpoint.place, fovy=viewpoint.fovy_deg)
    right, down, _ = viewpoint.axes.T
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


def fractal_noise(random: np.random.Generator, height: int, width: int, octaves: int) -> Field:
    """Smooth noise in 0..1, shape (height, width); each octave halves scale and strength."""
    total = np.zeros((height, width), np.float32)
    for octave in range(octaves):
        cells = 2 ** (octave + 2)
        grid = random.random((cells, cells), np.float32)
        total += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) / 2**octave
    low, high = float(total.min()), float(total.max())
    return (total - low) / (high - low)


def _tinted(shade: Field, dark: Colour, bright: Colour) -> Field:
    """Shade 0..1 becomes a colour between `dark` and `bright`."""
    spans = [
        (np.float32(low), np.float32(high - low)) for low, high in zip(dark, bright, strict=True)
    ]
    return np.asarray(cv2.merge([low + shade * span for low, span in spans]), np.float32)


def _grained(random: np.random.Generator, image: Field | Image, sigma: float) -> Image:
    """The image with fine grain of `sigma` grey levels, clipped to 0..255."""
    grain = random.standard_normal(image.shape[:2], np.float32) * sigma
    grained = np.add(image, cv2.merge([grain] * 3))
    return np.clip(grained, 0, 255, out=grained).astype(np.uint8)


def wood(random: np.random.Generator, height: int, width: int) -> Image:
    """Planks along the image's width, pale so that coloured things stand out."""
    planks = 5
    edge = height // planks
    image = np.empty((height, width, 3), np.float32)
    for plank in range(planks):
        top = plank * edge
        rows = height - top if plank == planks - 1 else edge
        warp = fractal_noise(random, rows, width, 5)
        across = np.linspace(0, 1, rows, dtype=np.float32)[:, None]
        rings = 0.5 + 0.5 * np.sin(26.0 * (across + 0.55 * warp) + random.uniform(0, 6))
        fibres = cv2.resize(random.random((rows, max(4, width // 40)), np.float32), (width, rows))
        shade = 0.55 * rings + 0.45 * fibres
        tone = random.uniform(-14, 10)
        image[top : top + rows] = _tinted(shade, (138, 116, 92), (198, 178, 150)) + tone
        image[top : top + 3] *= 0.55
    return _grained(random, image, 5.0)


def brick(random: np.random.Generator, height: int, width: int) -> Image:
    """A brick wall in running bond, painted unevenly."""
    image = np.full((height, width, 3), (172, 166, 158), np.float32)
    tall, wide, joint = height // 12, width // 6, max(2, height // 150)
    for course in range(13):
        for column in range(-1, 7):
            left = column * wide + (course % 2) * wide // 2
            colour = np.array((148, 126, 116)) + random.normal(0, 13) + random.normal(0, 5, 3)
            corner = (left + joint, course * tall + joint)
            cv2.rectangle(
                image, corner, (left + wide - joint, (course + 1) * tall - joint),
                colour.tolist(), -1,
            )  # fmt: skip
    image *= 0.82 + 0.36 * fractal_noise(random, height, width, 7)[..., None]
    return _grained(random, image, 7.0)


def concrete(random: np.random.Generator, height: int, width: int) -> Image:
    """A worn grey floor."""
    shade = fractal_noise(random, height, width, 8)
    return _grained(random, _tinted(shade, (84, 86, 90), (142, 142, 140)), 8.0)


def brushed(random: np.random.Generator, height: int, width: int) -> Image:
    """Brushed dark aluminium."""
    streaks: Field = np.asarray(
        cv2.resize(random.random((height, 6), np.float32), (width, height)), np.float32
    )
    return _grained(random, _tinted(streaks, (62, 65, 72), (118, 121, 128)), 5.0)


def card(random: np.random.Generator, height: int, width: int) -> Image:
    """Corrugated card with a printed label and tape."""
    flutes = 0.5 + 0.5 * np.sin(np.linspace(0, 70 * np.pi, width, dtype=np.float32))[None, :]
    shade = 0.25 * flutes + 0.75 * fractal_noise(random, height, width, 6)
    image = _grained(random, _tinted(shade, (128, 104, 82), (176, 152, 124)), 5.0)
    cv2.rectangle(image, (0, height * 2 // 5), (width, height // 2), (186, 176, 158), -1)
    tall, wide = height * 2 // 5, width * 3 // 5
    image[height // 2 + 8 : height // 2 + 8 + tall, 12 : 12 + wide] = label(random, tall, wide)
    return image


def label(
    random: np.random.Generator, height: int, width: int, paper: Colour = WHITE, ink: Colour = INK
) -> Image:
    """A printed label: a frame, lines of text and a bar code."""
    image = np.full((height, width, 3), paper, np.uint8)
    cv2.rectangle(image, (3, 3), (width - 4, height - 4), ink, max(1, width // 100))
    line_height = max(10, height // 8)
    scale = line_height / 34.0
    for row in range(1, 6):
        text = f"{random.choice(_WORDS)} {random.integers(10, 99999)}"
        if row == 1:
            text = "TAMS LAB"
        thickness = 2 if row == 1 and scale > 0.4 else 1
        place = (10, row * line_height + line_height // 3)
        cv2.putText(image, text, place, _FONT, scale, ink, thickness, cv2.LINE_AA)
    left, bottom = 10, height - 10
    while left < width - 14:
        bar = int(random.integers(1, max(2, width // 60) + 1))
        cv2.rectangle(image, (left, bottom - height // 5), (left + bar - 1, bottom), ink, -1)
        left += bar + int(random.integers(1, max(2, width // 60) + 1))
    return _grained(random, image, 2.5)


def marker(
    random: np.random.Generator,
    height: int,
    width: int,
    identity: int,
    dark: Colour,
    bright: Colour,
    quiet_cells: int = 1,
) -> Image:
    """ArUco marker `identity` of 4x4_50 in a quiet zone of whole cells, two colours, a square."""
    side = height // (6 + 2 * quiet_cells) * 6
    code = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), identity, side
    )
    image = np.full((height, width, 3), bright, np.uint8)
    margin = (height - side) // 2
    inside = image[margin : margin + side, margin : margin + side]
    inside[code < 128] = dark
    return _grained(random, image, 3.0)


def panel(random: np.random.Generator, height: int, width: int, paint: Colour) -> Image:
    """A moulded plastic panel: ribs, a stencilled number, scuffs."""
    shade = 0.7 + 0.3 * fractal_noise(random, height, width, 6)
    image = shade[..., None] * np.array(paint, np.float32)
    for left in range(0, width, max(8, width // 12)):
        image[:, left : left + 2] *= 0.72
    bright = tuple(min(255, int(1.25 * part + 60)) for part in paint)
    scale = height / 60.0
    place = (width // 10, height * 7 // 10)
    cv2.putText(image, f"BIN {random.integers(1, 99):02d}", place, _FONT, scale, bright, 3)
    return _grained(random, image, 4.0)


def work_mat(
    random: np.random.Generator, height: int, width: int, size_m: tuple[float, float]
) -> Image:
    """A cutting mat of `size_m` (height, width) [m]: 10 mm grid, figures, markers 10..13.

    Markers are 48 mm with their quiet zone, 10 and 11 at the upper corners, 12 and 13 below.
    """
    fitted_height, per_m = height, width / size_m[1]  # drawn with square pixels, then fitted
    height = round(size_m[0] * per_m)
    shade = fractal_noise(random, height, width, 7)
    image = _tinted(shade, (58, 62, 70), (84, 88, 96))
    for step in range(1, int(max(size_m) * 100)):
        at = round(step * 0.01 * per_m)
        colour, thick = ((150, 154, 158), 2) if step % 5 == 0 else ((104, 108, 114), 1)
        cv2.line(image, (at, 0), (at, height), colour, thick, cv2.LINE_AA)
        cv2.line(image, (0, height - at), (width, height - at), colour, thick, cv2.LINE_AA)
        if step % 5 == 0:
            scale = 0.010 * per_m / 26
            for place in ((at + 4, height - 8), (at + 4, height // 2 - 6), (6, height - at - 5)):
                cv2.putText(
                    image, f"{step * 10}", place, _FONT, scale, (192, 194, 196), 1, cv2.LINE_AA
                )
    title = (round(0.20 * per_m), round(0.045 * per_m))
    cv2.putText(
        image, "TAMS  pick & place  mm", title, _FONT, per_m / 1300, (205, 206, 208), 3,
        cv2.LINE_AA,
    )  # fmt: skip
    edge = round(0.048 * per_m) // 8 * 8
    gap = round(0.008 * per_m)
    corners = ((gap, gap), (gap, width - gap - edge), (height - gap - edge, gap),
               (height - gap - edge, width - gap - edge))  # fmt: skip
    worn = _grained(random, image, 4.0)
    for identity, (top, left) in enumerate(corners, start=10):
        worn[top : top + edge, left : left + edge] = marker(
            random, edge, edge, identity, INK, WHITE
        )
    return np.asarray(
        cv2.resize(worn, (width, fitted_height), interpolation=cv2.INTER_AREA), np.uint8
    )


# What paints the textures, given a random generator, height and width [px]; of a cube each face.
_PAINTERS: dict[str, Callable[[np.random.Generator, int, int], Image]] = {
    "table": wood,
    "mat": partial(work_mat, size_m=_MAT_M),
    "wall": brick,
    "floor": concrete,
    "poster": label,
    "sheet": label,
    "housing": brushed,
    "arm_print": partial(label, paper=(226, 228, 230), ink=(60, 62, 70)),
    "gripper_marker": partial(marker, identity=GRIPPER_MARKER, dark=INK, bright=WHITE),
    "block": partial(marker, identity=BLOCK_MARKER, dark=BLOCK_DARK, bright=BLOCK_BRIGHT),
    "bin_wall": partial(panel, paint=CONTAINER_PAINT),
    "bin_floor": partial(
        marker,
        identity=CONTAINER_MARKER,
        dark=(14, 40, 110),
        bright=(120, 190, 250),
        quiet_cells=3,
    ),
    "carton": card,
    "can": partial(label, paper=(188, 60, 132), ink=(250, 240, 246)),
    "jar": partial(label, paper=(236, 232, 220), ink=(64, 40, 92)),
    "tin": partial(label, paper=(58, 56, 62), ink=(230, 206, 120)),
}

"""A camera on a flange above a plane with a pattern, for any size of picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.prediction.plane_warp import mounted
from tams_app.prediction.present import PredictedCamera
from tams_app.records import Image, Lens, MountPrediction, Pose, Solid, SolidKind
from tams_app.rotation import Rotation

STRAIGHT = Rotation.identity()
LOOKS_DOWN = Rotation.from_rotvec((np.pi, 0.0, 0.0))
MOUNT = Pose(np.array([0.0, 0.05, 0.0]), STRAIGHT)


def lens_of(width: int, height: int) -> Lens:
    return Lens.ideal("flange", MOUNT, 60.0, width, height)


GRIP = Solid(SolidKind.BOX, Pose(np.array([0.0, 0.05, 0.06]), STRAIGHT), (0.02,) * 3, (0.0,) * 3)


def camera_of(width: int, height: int) -> PredictedCamera:
    """With nothing before it but closed fingers."""
    return PredictedCamera(lens_of(width, height), (), (GRIP,))


def above(x: float, y: float, z: float, turn: Rotation = STRAIGHT) -> Pose:
    """A camera, or a flange, that looks down at the plane."""
    return Pose(np.array([x, y, z]), turn * LOOKS_DOWN)


def picture(lens: Lens, flange: Pose, finer: float = 1.0) -> Image:
    """A smooth pattern on the plane z = 0, BGR, as the camera on `flange` sees it.

    `finer`: how many times finer than waves of 16 and 11 cm.
    """
    camera = mounted(flange, lens.pose)
    x, y = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
    slopes = lens.slopes(np.stack((x, y), axis=-1).reshape(-1, 2).astype(float))
    rays = np.insert(slopes, 2, 1.0, axis=1).reshape(lens.height, lens.width, 3)
    rays = rays @ camera.rotation.as_matrix().T
    points = camera.position - rays * (camera.position[2] / rays[..., 2:])
    x, y = finer * points[..., 0], finer * points[..., 1]
    wave = 127 + 60 * np.sin(40 * x) + 60 * np.cos(55 * y)
    return np.repeat(wave[..., None], 3, axis=2).astype(np.uint8)


def placed(now_ns: int, then: Pose, now: Pose, late_ns: int = 0, **more: Any) -> MountPrediction:
    """The mount was at `then` so long before, and is believed to be at `now`."""
    then_ns = now_ns - late_ns + more.get("offset_ns", 0)
    return MountPrediction(then_ns, then, now_ns, now, **more)

"""Overlays of SteamVR: flat pictures in the room or before the head, cut from one OpenGL texture.

All calls belong to the thread in which the texture's context is current.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.openvr.runtime import OpenVrRuntime, binding_errors
from hw.openvr.tracking import pose_matrix, tracking_problem
from tams_app.errors import DeviceError

Matrix = NDArray[np.float64]
_STEEP = 0.95  # sine of a gaze up or down, which has hardly a direction of its own


class Overlays:
    """Pictures that are created once, and then neither created anew nor hidden.

    They stand around the head: with `follow_head` they move with it, else they stay where it was
    when the headset was first tracked, put on again, or recentred. Until they have a place they
    are not shown.
    """

    def __init__(self, runtime: OpenVrRuntime, names: Sequence[str], follow_head: bool) -> None:
        """DeviceError in one sentence if SteamVR refuses them."""
        self._runtime, self._follow_head = runtime, follow_head
        try:
            self._overlay = runtime.vr.VROverlay()
            self._handles = [self._create(name) for name in names]
        except binding_errors(runtime.vr) as error:
            raise DeviceError(
                f"SteamVR refuses the overlays ({type(error).__name__}): is another TAMS running?"
            ) from error
        self._poses: list[Matrix] = [np.eye(4) for _ in names]
        self._texture = runtime.vr.Texture_t(eType=runtime.vr.TextureType_OpenGL)
        # what cameras give, and what is drawn here, is gamma-encoded
        self._texture.eColorSpace = runtime.vr.ColorSpace_Gamma
        self._placed = False

    def arrange(self, number: int, pose: Matrix, width_m: float) -> None:
        """Place an overlay before a head that looks straight on, before the first `look`.

        pose: from its own axes (x right, y up, z towards the eyes), shape (4, 4) [m].
        """
        self._poses[number] = pose
        self._overlay.setOverlayWidthInMeters(self._handles[number], width_m)

    def crop(self, number: int, left: float, top: float, right: float, bottom: float) -> None:
        """Set the part of the texture that it shows, as shares of its width and height.

        `top` is the share of rows above it, the first row put into the texture being the upper one.
        SteamVR counts an OpenGL texture's v from the other end.
        """
        bounds = self._runtime.vr.VRTextureBounds_t(left, 1.0 - top, right, 1.0 - bottom)
        self._overlay.setOverlayTextureBounds(self._handles[number], bounds)

    def submit(self, number: int, texture: int) -> None:
        """Show what is in the OpenGL texture of this name now."""
        self._texture.handle = texture
        self._overlay.setOverlayTexture(self._handles[number], self._texture)

    def look(self) -> str:
        """Take in what has happened, and keep them in their place.

        Why nothing is shown any more, "" if all is well.
        """
        runtime = self._runtime
        events = runtime.events()
        if events.quits:
            return "SteamVR has quit"
        if events.frame_moved:
            self._placed = False
        if self._follow_head:
            if not self._placed:
                self._put_at_head()
        elif runtime.rests(runtime.vr.k_unTrackedDeviceIndex_Hmd):
            self._placed = False
        elif not self._placed:
            self._put_into_the_room()
        return ""

    def _create(self, name: str) -> int:
        return int(self._overlay.createOverlay(f"tams.{name}", f"TAMS {name}"))

    def _put_at_head(self) -> None:
        head = self._runtime.vr.k_unTrackedDeviceIndex_Hmd
        for handle, pose in zip(self._handles, self._poses, strict=True):
            self._overlay.setOverlayTransformTrackedDeviceRelative(
                handle, head, self._hmd_matrix(pose)
            )
        self._show()

    def _put_into_the_room(self) -> None:
        """Around the head where it is now, upright however it is tilted."""
        vr = self._runtime.vr
        device = self._runtime.poses()[vr.k_unTrackedDeviceIndex_Hmd]
        if tracking_problem(vr, device):
            return
        base = _upright(pose_matrix(device))
        for handle, pose in zip(self._handles, self._poses, strict=True):
            self._overlay.setOverlayTransformAbsolute(
                handle, vr.TrackingUniverseStanding, self._hmd_matrix(base @ pose)
            )
        self._show()

    def _show(self) -> None:
        self._placed = True
        for handle in self._handles:
            self._overlay.showOverlay(handle)

    def _hmd_matrix(self, pose: Matrix) -> Any:
        matrix = self._runtime.vr.HmdMatrix34_t()
        for row, values in zip(matrix.m, pose[:3], strict=True):
            row[:] = values.tolist()
        return matrix


def _upright(head: Matrix) -> Matrix:
    """Place and direction of a head, shape (3, 4), without its nodding and tilting: (4, 4)."""
    right, backwards = head[:, 0], head[:, 2]
    level = backwards if abs(backwards[1]) < _STEEP else np.cross(right, (0.0, 1.0, 0.0))
    angle = atan2(level[0], level[2])
    base = np.eye(4)
    base[0, [0, 2]] = np.cos(angle), np.sin(angle)
    base[2, [0, 2]] = -np.sin(angle), np.cos(angle)
    base[:3, 3] = head[:, 3]
    return base

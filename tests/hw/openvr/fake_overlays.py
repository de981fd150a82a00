"""The overlays of an OpenVR runtime, and what an eye would see of them.

As SteamVR does, `setOverlayTexture` takes a copy of the OpenGL texture of the caller's context. Of
such a copy the v of bounds counts from the row that was put last: so a picture whose rows were put
in from top to bottom stands upright with vMin above vMax.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np
import openvr

_HANDLES = count(500)


@dataclass
class FakeOverlay:
    """One overlay; `transform` is the top of its pose, shape (3, 4), relative to `of`."""

    key: str
    name: str
    shown: bool = False
    width_m: float = 1.0
    of: str = "nothing"  # "room" or "head"
    transform: np.ndarray = field(default_factory=lambda: np.eye(3, 4))
    bounds: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)  # u, v; u, v
    texture: np.ndarray | None = None  # RGBA, shape (height, width, 4), rows as they were put
    colour_space: int = -1
    submitted: int = 0


class FakeOverlays:
    """All overlays of an application by their handles, and what was done to them, in order."""

    def __init__(self) -> None:
        self.reads_back = True  # else textures are not copied: for measurements
        self.by_handle: dict[int, FakeOverlay] = {}
        self.done: list[tuple[str, str]] = []  # function, the overlay's key
        self.error = openvr.VROverlayError_None  # of everything
        self.lock = threading.Lock()

    def of(self, key: str) -> FakeOverlay:
        """The overlay with this key."""
        return next(overlay for overlay in self.by_handle.values() if overlay.key == key)

    def seen(self, key: str) -> np.ndarray:
        """What is seen of an overlay: BGR, shape (height, width, 3), upper row first."""
        with self.lock:
            overlay = self.of(key)
            if overlay.texture is None:
                return np.zeros((0, 0, 3), np.uint8)
            height, width, _ = overlay.texture.shape
            u_left, v_upper, u_right, v_lower = overlay.bounds
            columns = (np.arange(width) + 0.5) / width
            v_of_rows = 1 - (np.arange(height) + 0.5) / height
            inside = (v_of_rows > min(v_upper, v_lower)) & (v_of_rows < max(v_upper, v_lower))
            rows = overlay.texture[inside][:, (columns > u_left) & (columns < u_right), 2::-1]
            # down the picture v goes from vMin to vMax; with the rows it goes down
            return rows.copy() if v_upper > v_lower else rows[::-1].copy()

    def functions(self) -> dict[str, Callable[..., Any]]:
        """The entries of the function table."""

        def create(key: bytes, name: bytes, handle: Any) -> int:
            if self.error:
                return self.error
            with self.lock:
                if any(overlay.key == key.decode() for overlay in self.by_handle.values()):
                    return openvr.VROverlayError_KeyInUse
                handle[0] = next(_HANDLES)
                self.by_handle[handle[0]] = FakeOverlay(key.decode(), name.decode())
            return 0

        def entry(name: str, do: Callable[..., None]) -> Callable[..., int]:
            def call(handle: int, *arguments: Any) -> int:
                if self.error:
                    return self.error
                with self.lock:
                    overlay = self.by_handle.get(handle)
                    if overlay is None:
                        return openvr.VROverlayError_UnknownOverlay
                    self.done.append((name, overlay.key))
                    do(overlay, *arguments)
                return 0

            return call

        def show(overlay: FakeOverlay) -> None:
            overlay.shown = True

        def widen(overlay: FakeOverlay, width_m: float) -> None:
            overlay.width_m = width_m

        def bound(overlay: FakeOverlay, bounds: Any) -> None:
            given = bounds.contents
            overlay.bounds = (given.uMin, given.vMin, given.uMax, given.vMax)

        def to_room(overlay: FakeOverlay, origin: int, matrix: Any) -> None:
            assert origin == openvr.TrackingUniverseStanding
            overlay.of, overlay.transform = "room", _array(matrix)

        def to_head(overlay: FakeOverlay, device: int, matrix: Any) -> None:
            assert device == openvr.k_unTrackedDeviceIndex_Hmd
            overlay.of, overlay.transform = "head", _array(matrix)

        def submit(overlay: FakeOverlay, texture: Any) -> None:
            given = texture.contents
            assert given.eType == openvr.TextureType_OpenGL
            overlay.colour_space = given.eColorSpace
            overlay.submitted += 1
            if self.reads_back:
                overlay.texture = _read_back(given.handle)

        names: dict[str, Callable[..., None]] = {
            "showOverlay": show,
            "setOverlayWidthInMeters": widen,
            "setOverlayTextureBounds": bound,
            "setOverlayTransformAbsolute": to_room,
            "setOverlayTransformTrackedDeviceRelative": to_head,
            "setOverlayTexture": submit,
        }
        return {"createOverlay": create, **{n: entry(n, do) for n, do in names.items()}}


def _array(matrix: Any) -> np.ndarray:
    return np.array([list(row) for row in matrix.contents.m])


def _read_back(texture: int) -> np.ndarray:
    """The texture of this name in the current context; leaves another one bound, as SteamVR may."""
    from OpenGL import GL  # here: its platform must be the caller's

    GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
    size = (ctypes.c_int * 3)()
    for number, what in enumerate(
        (GL.GL_TEXTURE_WIDTH, GL.GL_TEXTURE_HEIGHT, GL.GL_TEXTURE_INTERNAL_FORMAT)
    ):
        size[number] = GL.glGetTexLevelParameteriv(GL.GL_TEXTURE_2D, 0, what)
    width, height, internal = size
    assert internal == GL.GL_SRGB8_ALPHA8, "SteamVR on Linux takes nothing else"
    content = GL.glGetTexImage(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE)
    GL.glBindTexture(GL.GL_TEXTURE_2D, 0)
    return np.frombuffer(content, np.uint8).reshape(height, width, 4).copy()

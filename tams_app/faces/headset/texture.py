"""The atlas as an OpenGL texture, in the context of a window that is never shown.

SteamVR takes the texture from the context that is current. On Linux it asks GLX for that, so the
context needs an X display (Xwayland's is one); a context of EGL would not be found.
"""

from __future__ import annotations

import importlib
import os
from typing import Any

from tams_app.errors import SetupError
from tams_app.faces.headset.painting import Pixels

_SIDE_PX = 16


class AtlasTexture:
    """One texture and its context, which is current from now on; all calls in one thread."""

    def __init__(self) -> None:
        """SetupError in one sentence where there is no OpenGL."""
        self._glfw, self._gl = _load()
        try:
            self._glfw.init()
            self._glfw.window_hint(self._glfw.VISIBLE, False)
            self._window = self._glfw.create_window(_SIDE_PX, _SIDE_PX, "TAMS headset", None, None)
            self._glfw.make_context_current(self._window)
        except self._glfw.GLFWError as error:
            raise SetupError(
                f"the headset needs OpenGL on an X display ({_words(error)})"
            ) from error
        self.handle = 0

    def create(self, width: int, height: int) -> None:
        """Make the texture, black; `handle` is its name from now on. SetupError if it cannot be."""
        gl = self._gl
        try:
            self.handle = int(gl.glGenTextures(1))
            gl.glBindTexture(gl.GL_TEXTURE_2D, self.handle)
            # SteamVR on Linux takes 8 bits of sRGB with alpha and nothing else
            gl.glTexImage2D(
                *(gl.GL_TEXTURE_2D, 0, gl.GL_SRGB8_ALPHA8, width, height, 0),
                *(gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, bytes(4 * width * height)),
            )
            gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR)
            gl.glTexParameteri(gl.GL_TEXTURE_2D, gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR)
        except gl.GLError as error:
            raise SetupError(
                f"OpenGL has no texture of {width} by {height} pixels ({error.err})"
            ) from error

    def put(self, left: int, top: int, pixels: Pixels) -> None:
        """Replace a part; the first row given is the picture's upper one."""
        gl = self._gl
        height, width, _ = pixels.shape
        gl.glBindTexture(gl.GL_TEXTURE_2D, self.handle)  # SteamVR may have left another one bound
        gl.glTexSubImage2D(
            *(gl.GL_TEXTURE_2D, 0, left, top, width, height),
            *(gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, pixels),
        )

    def flush(self) -> None:
        """Hand over to the graphics processor what was put, without waiting for it."""
        self._gl.glFlush()

    def close(self) -> None:
        """Give texture and context back."""
        self._glfw.terminate()


def _words(error: Exception) -> str:
    """GLFW's own: the binding hands them over as "(number) b'words'"."""
    return str(error).partition("b'")[2].rstrip("'") or str(error)


def _load() -> tuple[Any, Any]:
    """GLFW and OpenGL, in this process for GLX."""
    os.environ["PYGLFW_LIBRARY_VARIANT"] = "x11"
    os.environ["PYOPENGL_PLATFORM"] = "glx"
    try:
        glfw: Any = importlib.import_module("glfw")
        gl = importlib.import_module("OpenGL.GL")
    except (ImportError, OSError, AttributeError) as error:
        raise SetupError(
            f"OpenGL cannot be loaded ({error}): run `apt-get install libgl1`"
        ) from error
    glfw.ERROR_REPORTING = "exception"
    return glfw, gl

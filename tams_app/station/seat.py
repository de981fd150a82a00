"""Where the operator sits: at this computer, or at another one by a remote desktop or terminal."""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

from tams_app.config import Config
from tams_app.errors import SetupError

_BY_TERMINAL = ("SSH_CONNECTION", "SSH_CLIENT", "SSH_TTY")
_BY_DESKTOP = ("XRDP_SESSION", "VNCDESKTOP")
_EXTENSIONS = {b"VNC-EXTENSION": "a VNC server", b"XWAYLAND": "an X server within Wayland"}
_ANSWER_S = 5.0


def require_local_seat(config: Config, is_real: bool, what: str) -> None:
    """SetupError if the keys that move a real arm come from a seat that may hold releases back.

    `is_real`: whether the arm is, wherever it stands; a simulated one may be moved from anywhere.
    `what` they come from, as in "what is remote".
    """
    if not is_real or config.controller.remote_seat:
        return
    if why := remote_seat(os.environ):
        raise SetupError(
            f"{what} is remote ({why}), where the release of a key may come late or never while "
            "the arm moves: work at this computer, or set controller.remote_seat in the "
            "configuration"
        )


def remote_seat(environment: Mapping[str, str]) -> str:
    """Why the seat is a remote one, "" if nothing says so."""
    for name in (*_BY_TERMINAL, *_BY_DESKTOP):
        if environment.get(name):
            return f"{name} is set"
    if logind_session() == "yes":
        return "logind calls the session remote"
    display = environment.get("DISPLAY", "")
    if not display or environment.get("WAYLAND_DISPLAY"):
        if environment.get("GDK_BACKEND", "").startswith("x11"):
            return "GDK_BACKEND asks for an X server within Wayland"
        return ""
    if not display.startswith((":", "unix:", "unix/")):
        return f"the X server {display} is on another computer or comes by ssh"
    found = (_EXTENSIONS[name] for name in x_extensions(display) if name in _EXTENSIONS)
    return next((f"the X server {display} is {kind}" for kind in found), "")


def session_name() -> str:
    """What logind calls the session of this process; "" if it is of none."""
    found = re.search(r"/session-(\w+)\.scope", Path("/proc/self/cgroup").read_text())
    return found[1] if found else os.environ.get("XDG_SESSION_ID", "")


def logind_session() -> str:
    """What logind says to whether this process's session is remote: yes, no, or nothing."""
    try:
        if not (name := session_name()):
            return ""  # of no session: logind would speak of itself
        command = ["loginctl", "show-session", name, "--property=Remote", "--value"]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_ANSWER_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def x_extensions(display: str) -> tuple[bytes, ...]:
    """Those of `_EXTENSIONS` that the X server has; none where it does not answer."""
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return ()
    x11.XOpenDisplay.restype = ctypes.c_void_p
    connection = ctypes.c_void_p(x11.XOpenDisplay(display.encode()))
    if not connection:
        return ()
    code = ctypes.byref(ctypes.c_int())
    found = tuple(
        name for name in _EXTENSIONS if x11.XQueryExtension(connection, name, code, code, code)
    )
    x11.XCloseDisplay(connection)
    return found

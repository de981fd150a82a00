"""An X server without a screen, its picture, and keys pressed on it as by a keyboard."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

from tams_app.records import Image


class Screen:
    """The server's only screen."""

    def __init__(self, number: str, folder: Path, width: int, height: int, pid: int) -> None:
        self.display = f":{number}"
        self.pid = pid
        self._dump = folder / "Xvfb_screen0"
        self.shape = (height, width)

    def photograph(self) -> Image:
        """What is on the screen now: BGR, shape (height, width, 3)."""
        dump = self._dump.read_bytes()  # XWD: header, colour map, BGRX rows
        (header_bytes,) = struct.unpack_from(">I", dump, 0)
        (colours,) = struct.unpack_from(">I", dump, 19 * 4)
        start = header_bytes + colours * 12
        height, width = self.shape
        pixels = np.frombuffer(dump, np.uint8, width * height * 4, start)
        return pixels.reshape(height, width, 4)[:, :, :3]

    def xdotool(self, *arguments: str) -> str:
        """What xdotool prints; it presses keys through the server's XTEST extension."""
        return self._run("xdotool", *arguments)

    def _run(self, *command: str) -> str:
        done = subprocess.run(
            command,
            env=os.environ | {"DISPLAY": self.display},
            capture_output=True,
            text=True,
            check=True,
            timeout=30,
        )
        return done.stdout.strip()

    def layout(self, layout: str, *options: str) -> None:
        """Set the keyboard's layouts, as `us,ru`, and options of XKB, in place of those before."""
        given = [word for one in options for word in ("-option", one)]
        self._run("setxkbmap", "-layout", layout, "-option", "", *given)

    @contextmanager
    def keyboard_grabbed(self) -> Iterator[None]:
        """Another client has all keys meanwhile, as a window manager that shows a menu."""
        x11, display = self._connection()
        root = ctypes.c_ulong(x11.XDefaultRootWindow(display))
        asynchronously, now = 1, ctypes.c_ulong(0)
        assert x11.XGrabKeyboard(display, root, 0, asynchronously, asynchronously, now) == 0
        try:
            yield
        finally:
            x11.XCloseDisplay(display)

    @contextmanager
    def full_but_for(self, free: int) -> Iterator[None]:
        """Others have all connections that the server takes but so many, meanwhile."""
        taken = list(takewhile(lambda one: one[1].value, iter(self._connection, None)))
        for x11, connection in taken[:free]:
            x11.XCloseDisplay(connection)
        yield
        for x11, connection in taken[free:]:
            x11.XCloseDisplay(connection)

    def focus(self, title: str) -> None:
        """Give the window of this title the focus, as a window manager would."""
        self.xdotool("windowfocus", "--sync", self._window(title))

    def ask_to_close(self, title: str) -> None:
        """What a window manager sends when its button of the window of this title is clicked."""
        x11, display = self._connection()
        window = ctypes.c_ulong(int(self._window(title)))
        event = _ClientMessage(type=33, send_event=1, window=window, format=32)
        event.message_type = x11.XInternAtom(display, b"WM_PROTOCOLS", 0)
        event.data[0] = x11.XInternAtom(display, b"WM_DELETE_WINDOW", 0)
        x11.XSendEvent(display, window, 0, ctypes.c_long(0), ctypes.byref(event))
        x11.XCloseDisplay(display)

    def _connection(self) -> tuple[ctypes.CDLL, ctypes.c_void_p]:
        """One of its own to the server; null if the server takes no more."""
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        x11.XDefaultRootWindow.restype = x11.XInternAtom.restype = ctypes.c_ulong
        return x11, ctypes.c_void_p(x11.XOpenDisplay(self.display.encode()))

    def _window(self, title: str) -> str:
        return self.xdotool("search", "--sync", "--onlyvisible", "--name", title).split()[0]


class _ClientMessage(ctypes.Structure):
    """XClientMessageEvent of Xlib, with room for any XEvent."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 24),
    )


@contextmanager
def virtual_screen(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    width: int = 1280,
    height: int = 720,
    *options: str,
) -> Iterator[Screen]:
    """A server for as long as the context lasts; DISPLAY names it. `options`: of Xvfb, further."""
    for program in ("Xvfb", "xdotool", "setxkbmap"):
        if shutil.which(program) is None:
            pytest.skip(f"needs {program} (see apt-packages.txt)")
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            *("Xvfb", "-displayfd", str(writing), "-fbdir", str(folder)),
            *("-screen", "0", f"{width}x{height}x24"),
            *options,
        ],
        pass_fds=(writing,),
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as number:
        screen = Screen(number.readline().strip(), folder, width, height, server.pid)
    monkeypatch.setenv("DISPLAY", screen.display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "state"))
    try:
        yield screen
    finally:
        server.terminate()
        server.wait(10)


@contextmanager
def compositor(screen: Screen, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A Wayland compositor in a window of `screen`, for as long as the context lasts; its pid."""
    if shutil.which("weston") is None:
        pytest.skip("needs weston (see apt-packages.txt)")
    folder.chmod(0o700)
    height, width = screen.shape
    with (folder / "weston.log").open("w") as log:
        program = subprocess.Popen(
            [
                *("weston", "--backend=x11-backend.so", "--use-pixman", "--shell=kiosk-shell.so"),
                *(f"--width={width}", f"--height={height}", "--socket=tams-test", "--no-config"),
                "--idle-time=0",
            ],
            stdout=log,
            stderr=log,
        )
    monkeypatch.setenv("WAYLAND_DISPLAY", "tams-test")
    monkeypatch.delenv("DISPLAY")
    try:
        assert wait_for((folder / "tams-test").exists), (folder / "weston.log").read_text()
        yield program.pid
    finally:
        program.send_signal(signal.SIGCONT)
        program.terminate()
        program.wait(10)


def wait_for(condition: Callable[[], bool], timeout_s: float = 60.0, every_s: float = 0.05) -> bool:
    """Whether it comes true in time; long, for machines that have other work."""
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(every_s)
    return condition()

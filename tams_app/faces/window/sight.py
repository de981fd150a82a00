"""Whether the operator can see what the window draws, as far as the desktop tells."""

from __future__ import annotations

import ctypes
import os
from typing import Any

from tams_app.faces.window.toolkit import load
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS

PAINTED_NS = 150 * NS_PER_MS  # the window asks for a paint 50 times a second
_ANSWER_MS = 1000  # of logind, once, before the window is shown
_MAP_STATE = 23  # the place of this int in XWindowAttributes, where pointers have 64 bits
_VIEWABLE = 2  # IsViewable of X.h: the window is mapped, and so is each that it lies in
_LOGIND = "org.freedesktop.login1"


class Sight:
    """Seen are frames that were painted a moment ago in a window that is mapped and not minimised.

    And no screen lock hides it. GTK paints again only once the compositor has taken the last
    frame, so paints end with it; an X server is asked, and while it does not answer this process
    waits. Without logind no lock is known.
    """

    def __init__(self, window: Any, clock: Clock) -> None:
        """`window`: realised."""
        Gdk = load().Gdk
        self._window, self._clock = window, clock
        states = Gdk.ToplevelState
        self._hidden = states.MINIMIZED | getattr(states, "SUSPENDED", states.MINIMIZED)  # GTK 4.12
        self._on_x11 = _x11_window(window.get_surface())
        self._session = _graphical_session()
        self._painted_ns = 0
        self._painted: dict[str, int] = {}  # by view, when the frame was decoded
        self._taken = self.seen_ns = self._painted
        self._stood_still = False  # since the last look

    def painted(self, now_ns: int, frames: dict[str, int]) -> None:
        """The window was painted, so the compositor has taken what was painted before.

        `frames`: those in it, by view, as when they were decoded.
        """
        self._stood_still |= now_ns - self._painted_ns > PAINTED_NS
        self._taken, self._painted, self._painted_ns = self._painted, frames, now_ns

    def look(self) -> bool:
        """Whether the operator sees the window now; if so `seen_ns` has the frames."""
        is_viewable = self._on_x11 is None or self._on_x11.is_viewable()  # may take long
        hidden = self._window.get_surface().get_state() & self._hidden
        stood_still, self._stood_still = self._stood_still, False
        if (
            not is_viewable
            or hidden
            or not self._window.get_mapped()
            or self._is_locked()
            or self._clock.now_ns() - self._painted_ns > PAINTED_NS
        ):
            return False
        self.seen_ns = self._taken
        return not stood_still  # a key may have gone up meanwhile

    def _is_locked(self) -> bool:
        """True while the screen is locked, or another session is in the foreground."""
        if self._session is None:
            return False
        locked = self._session.get_cached_property("LockedHint")
        active = self._session.get_cached_property("Active")
        return (locked is not None and locked.get_boolean()) or (
            active is not None and not active.get_boolean()
        )


class _X11Window:
    """A window of an X server, by a connection of its own."""

    def __init__(self, name: str, window: int) -> None:
        self._x11 = ctypes.CDLL("libX11.so.6")
        self._x11.XOpenDisplay.restype = ctypes.c_void_p
        self._display = ctypes.c_void_p(self._x11.XOpenDisplay(name.encode()))
        self._window = ctypes.c_ulong(window)
        self._attributes = (ctypes.c_int * 64)()  # XWindowAttributes, with room to spare

    def is_viewable(self) -> bool:
        """Ask the server, and wait for its answer."""
        found = ctypes.byref(self._attributes)
        if not self._x11.XGetWindowAttributes(self._display, self._window, found):
            return False
        return bool(self._attributes[_MAP_STATE] == _VIEWABLE)


def _x11_window(surface: Any) -> _X11Window | None:
    """None on Wayland."""
    if type(surface.get_display()).__name__ != "X11Display":
        return None
    return _X11Window(surface.get_display().get_name(), surface.get_xid())


def _graphical_session() -> Any:
    """The graphical session of this user as logind knows it, kept up to date; None without one."""
    modules = load()
    Gio, GLib = modules.Gio, modules.GLib

    def of(path: str, interface: str) -> Any:
        return Gio.DBusProxy.new_for_bus_sync(
            Gio.BusType.SYSTEM, 0, None, _LOGIND, path, f"{_LOGIND}.{interface}", None
        )

    try:
        manager = of("/org/freedesktop/login1", "Manager")
        manager.set_default_timeout(_ANSWER_MS)
        user = of(manager.GetUser("(u)", os.getuid()), "User").get_cached_property("Display")
        if user is None or not user.unpack()[0]:
            return None
        return of(user.unpack()[1], "Session")
    except GLib.Error:
        return None

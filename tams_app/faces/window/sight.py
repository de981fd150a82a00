"""Whether the operator can see what the window draws, as far as the desktop tells."""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from functools import cache
from typing import Any

from tams_app.errors import SetupError
from tams_app.faces.window.toolkit import load
from tams_app.runtime.clock import Clock
from tams_app.station.seat import session_name
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
        is_viewable = _is_viewable(self._window.get_surface())  # may take long
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


@cache
def x_server() -> tuple[ctypes.CDLL, ctypes.c_void_p] | None:
    """A connection of its own to the X server; None on Wayland. SetupError if it takes none."""
    display = load().Gdk.Display.get_default()
    if type(display).__name__ != "X11Display":
        return None
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    if not (connection := ctypes.c_void_p(x11.XOpenDisplay(display.get_name().encode()))):
        raise SetupError(f"the X server {display.get_name()} takes no second connection")
    return x11, connection


def _is_viewable(surface: Any) -> bool:
    """Ask the X server, and wait for its answer; True on Wayland."""
    if (server := x_server()) is None:
        return True
    x11, connection = server
    found = (ctypes.c_int * 64)()  # XWindowAttributes, with room to spare
    window = ctypes.c_ulong(surface.get_xid())
    answered = x11.XGetWindowAttributes(connection, window, ctypes.byref(found))
    return bool(answered and found[_MAP_STATE] == _VIEWABLE)


def _graphical_session() -> Any:
    """This process's graphical session, else its user's, as logind knows it; None without one."""
    modules = load()
    Gio, GLib = modules.Gio, modules.GLib

    def of(path: str, interface: str) -> Any:
        return Gio.DBusProxy.new_for_bus_sync(
            Gio.BusType.SYSTEM, 0, None, _LOGIND, path, f"{_LOGIND}.{interface}", None
        )

    try:
        manager = of("/org/freedesktop/login1", "Manager")
        manager.set_default_timeout(_ANSWER_MS)
        with suppress(GLib.Error, OSError):  # of none, as terminals that the user's systemd starts
            own = of(manager.GetSession("(s)", session_name() or "self"), "Session")
            if (kind := own.get_cached_property("Type")) and kind.unpack() in ("x11", "wayland"):
                return own
        user = of(manager.GetUser("(u)", os.getuid()), "User").get_cached_property("Display")
        return of(user.unpack()[1], "Session") if user and user.unpack()[0] else None
    except GLib.Error:
        return None

"""GTK 4, loaded on first use, in the window's process only."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tams_app.errors import SetupError


@dataclass(frozen=True, slots=True)
class Toolkit:
    """The modules of GObject introspection that the window uses (untyped at run time)."""

    Gtk: Any
    Gdk: Any
    GLib: Any
    Gio: Any


def draws_in_software(devices: Path = Path("/dev")) -> bool:
    """True if there is no graphics processor here that OpenGL could use."""
    return not any(devices.glob("dri/renderD*")) and not (devices / "nvidiactl").exists()


def is_installed() -> bool:
    """True if GTK 4 can be loaded here."""
    try:
        import gi

        gi.require_version("Gtk", "4.0")
        gi.require_foreign("cairo")
    except (ImportError, ValueError):
        return False
    return True


@cache
def load() -> Toolkit:
    """GTK 4 on a display that answers; SetupError in one sentence.

    Where it has to draw in software it does so with cairo, which takes half the time of OpenGL in
    software or less (`benchmarks.window cost` at 628dd78b). GSK_RENDERER chooses otherwise.
    """
    if draws_in_software():
        os.environ.setdefault("GSK_RENDERER", "cairo")
    try:
        import gi

        for module in ("Gtk", "Gdk"):
            gi.require_version(module, "4.0")
        gi.require_foreign("cairo")
        from gi.repository import Gdk, Gio, GLib, Gtk
    except (ImportError, ValueError) as error:
        raise SetupError(
            f"GTK 4 is missing ({error}): run `apt-get install gir1.2-gtk-4.0`"
        ) from error
    if not Gtk.init_check() or Gdk.Display.get_default() is None:
        raise SetupError("the display does not answer")
    return Toolkit(Gtk, Gdk, GLib, Gio)


def screen_size() -> tuple[int, int]:
    """Width and height of the first monitor [pixels of the application]."""
    monitors = load().Gdk.Display.get_default().get_monitors()
    geometry = monitors.get_item(0).get_geometry()
    return geometry.width, geometry.height

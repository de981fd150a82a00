"""GTK 4, loaded on first use, in the window's process only; and the size that its window had."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tams_app.errors import SetupError, TamsError

LEAST_WIDTH, LEAST_HEIGHT = 640, 400


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


@dataclass(frozen=True, slots=True)
class Size:
    """Of the window [px of the screen]; where it stands the window manager decides."""

    width: int = 1280
    height: int = 720
    maximised: bool = False


USUAL = Size()


def size_file(environment: Mapping[str, str] = os.environ) -> Path:
    """The file of the size: a state of the user (XDG base directories)."""
    state = environment.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "tams" / "window.json"


def first_size(screen_width: int, screen_height: int) -> Size:
    """The size before any is kept: maximised where the usual one would fill most of the screen."""
    fills_most = 2 * USUAL.width * USUAL.height > screen_width * screen_height
    return Size(maximised=fills_most)


def read_size(path: Path, first: Size = USUAL) -> Size:
    """The size kept there; `first` if there is nothing of use."""
    try:
        size = Size(**json.loads(path.read_text()))
        usable = size.width >= LEAST_WIDTH and size.height >= LEAST_HEIGHT
    except (OSError, ValueError, TypeError):
        return first
    return size if usable else first


def keep_size(path: Path, size: Size) -> None:
    """Keep `size`; TamsError if that is impossible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(size)) + "\n")
    except OSError as error:
        raise TamsError(f"{path}: the window's size cannot be kept: {error.strerror}") from error

"""One place for a view: its picture, a line of text in it, and what wakes for a new frame."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any

from tams_app.faces.window.toolkit import load
from tams_app.records import Image
from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import FrameReader

_LOOK_NS = 100 * NS_PER_MS  # whether it is to end, or another view is the large one


class PicturePlace:
    """A place that shows any view; `widget` goes into the window."""

    def __init__(self) -> None:
        Gtk = load().Gtk
        self._picture = Gtk.Picture(can_shrink=True, hexpand=True, vexpand=True)
        self._label = Gtk.Label(halign=Gtk.Align.START, valign=Gtk.Align.START)
        self._label.add_css_class("view-name")
        overlay = Gtk.Overlay(child=self._picture, hexpand=True, vexpand=True)
        overlay.add_overlay(self._label)
        self._notice = Gtk.Label(
            halign=Gtk.Align.CENTER, valign=Gtk.Align.START, ellipsize=3, visible=False
        )
        self._notice.add_css_class("notice")
        overlay.add_overlay(self._notice)
        self.widget = Gtk.Box(hexpand=True, vexpand=True)
        self.widget.add_css_class("view")
        self.widget.append(overlay)
        self._class = ""

    def show(self, texture: Any) -> None:
        """The picture from now on; None: none."""
        self._picture.set_paintable(texture)

    def set_title(self, title: str, colour_class: str) -> None:
        """Set the text in it, and the colour of its frame."""
        if title != self._label.get_text():
            self._label.set_text(title)
        if colour_class != self._class:
            self.widget.remove_css_class(self._class or "none")
            self.widget.add_css_class(colour_class)
            self._class = colour_class

    def notice(self, text: str) -> None:
        """The text over it from now on; "": none."""
        if text != self._notice.get_text():
            self._notice.set_text(text)
            self._notice.set_visible(bool(text))


def texture_of(image: Image) -> Any:
    """A texture of a BGR image, shape (height, width, 3)."""
    modules = load()
    height, width, _ = image.shape
    pixels = modules.GLib.Bytes.new(image.tobytes())
    return modules.Gdk.MemoryTexture.new(
        width, height, modules.Gdk.MemoryFormat.B8G8R8, pixels, width * 3
    )


class Arrivals:
    """Waits for frames of `view`, which may be set to another at any time by another thread."""

    def __init__(self, frames: Mapping[str, FrameReader], view: str) -> None:
        self.view = view
        self._frames = frames

    def until(self, stop: threading.Event) -> Iterator[str]:
        """The view of each new frame as it comes, until `stop` is set; in one thread."""
        seen: dict[str, int] = {}
        while not stop.is_set():
            view = self.view
            reader = self._frames[view]
            written = reader.written()
            if written == seen.get(view, 0):
                reader.await_more(written, _LOOK_NS)
                continue
            seen[view] = written
            yield view

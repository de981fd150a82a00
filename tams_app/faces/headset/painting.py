"""Pixels of the atlas: a view's cell and the panel, drawn with cairo.

Pixels are RGBA, shape (height, width, 4), opaque: what OpenGL keeps without reordering it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeAlias

import cairo
import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app import palette
from tams_app.faces.canvas import FAINT, GROUND, INK, PANEL, Context, fill, width_of, write
from tams_app.faces.headset.layout import Atlas, Crop
from tams_app.faces.shown import PanelWords
from tams_app.records import Image

Pixels: TypeAlias = NDArray[np.uint8]

_STRIPE_PX = 24.0
_BAND_PX = 96.0  # of the panel, in the state's colour
_TEXT_PX = 32.0  # about a degree high to the eyes, as the panel is 40 degrees wide
_MARGIN_PX = 24.0
SENTENCE_LINES = 3


class ViewCell:
    """One view's cell: its frame as it came, and around it whose it is and whether it is old."""

    def __init__(self, atlas: Atlas, colour: str) -> None:
        self._colour, self._scale = colour, atlas.scale
        cell, frame = next(iter(atlas.cells.values())), atlas.frame
        self.pixels: Pixels = np.zeros((cell.height, cell.width, 4), np.uint8)
        self.pixels[..., 3] = 255
        rows, columns = slice(frame.top, frame.top + frame.height), slice(frame.left, -frame.left)
        self._frame = self.pixels[rows, columns]
        self._header = self.pixels[: frame.top]
        self._edges = (
            self.pixels[frame.top :, : frame.left],
            self.pixels[frame.top :, -frame.left :],
            self.pixels[rows.stop :],
        )
        self._shown: tuple[str, bool, bool] | None = None

    def show(self, frame: Image) -> Image:
        """A BGR frame, shape (height, width, 3), from now on; the part of the cell that has it."""
        cv2.cvtColor(frame, cv2.COLOR_BGR2RGBA, dst=self._frame)
        if self._shown is not None and self._shown[2]:
            self._grey()
        return self._frame

    def set_title(self, title: str, old: bool, silent: bool = False) -> bool:
        """Set the text above the frame; True if anything has changed.

        `silent`: the session is, and the frame grey until the first one that comes afterwards.
        """
        if (title, old, silent) == self._shown:
            return False
        if silent and (self._shown is None or not self._shown[2]):
            self._grey()
        if self._shown is None or old != self._shown[1]:
            for edge in self._edges:
                with _drawn(edge) as (cr, width, height):
                    self._ground(cr, width, height, old)
        with _drawn(self._header) as (cr, width, height):
            self._head(cr, width, height, title, old)
        self._shown = title, old, silent
        return True

    def _grey(self) -> None:
        grey = cv2.cvtColor(self._frame, cv2.COLOR_RGBA2GRAY) // 2
        self._frame[..., :3] = grey[..., np.newaxis]

    def _ground(self, cr: Context, width: float, height: float, old: bool) -> None:
        if old:
            _stripes(cr, width, height)
        else:
            fill(cr, self._colour, 0, 0, width, height)

    def _head(self, cr: Context, width: float, height: float, title: str, old: bool) -> None:
        self._ground(cr, width, height, old)
        inset = 5 * self._scale
        ground, ink = (palette.YELLOW, GROUND) if old else (GROUND, INK)
        fill(cr, ground, 3 * inset, inset, width - 6 * inset, height - 2 * inset)
        write(cr, title, 5 * inset, height - 2.7 * inset, ink, 26 * self._scale, bold=True)


def paint_panel(panel: Crop, words: PanelWords) -> Pixels:
    """State and phase in a band of the state's colour, below it why, what helps, and a note."""
    pixels: Pixels = np.zeros((panel.height, panel.width, 4), np.uint8)
    with _drawn(pixels) as (cr, width, height):
        _panel(cr, width, height, words)
    return pixels


def _panel(cr: Context, width: float, height: float, words: PanelWords) -> None:
    look, margin = words.look, _MARGIN_PX
    fill(cr, PANEL, 0, 0, width, height)
    fill(cr, look.colour, 0, 0, width, _BAND_PX)
    write(cr, f"{look.sign} {look.word}", margin, 70, look.ink, 62, bold=True)
    phase_width = width_of(cr, words.phase, 52, bold=True)
    write(cr, words.phase, width - margin - phase_width, 67, look.ink, 52, bold=True)
    room = width - 2 * margin
    for number, line in enumerate(wrapped(cr, words.sentence, room, SENTENCE_LINES)):
        write(cr, line, margin, 138 + 42 * number, INK, _TEXT_PX)
    for line in wrapped(cr, words.key, room, 1, bold=True):
        write(cr, line, margin, 270, INK, _TEXT_PX, bold=True)
    for line in wrapped(cr, words.note, room, 1):
        write(cr, line, margin, 314, FAINT, _TEXT_PX)


def wrapped(cr: Context, text: str, room: float, most: int, bold: bool = False) -> list[str]:
    """The text in at most that many lines of this width; an ellipsis where it is cut."""

    def fits(line: str) -> bool:
        return width_of(cr, line, _TEXT_PX, bold) <= room

    lines: list[str] = []
    for word in text.split():
        if lines and fits(f"{lines[-1]} {word}"):
            lines[-1] += f" {word}"
        elif len(lines) < most:
            lines.append(word)
        else:
            while " " in lines[-1] and not fits(f"{lines[-1]} …"):
                lines[-1] = lines[-1].rpartition(" ")[0]
            lines[-1] += " …"
            break
    return lines


def _stripes(cr: Context, width: float, height: float) -> None:
    """Black and yellow, as of a hazard: no view and no state looks so."""
    fill(cr, GROUND, 0, 0, width, height)
    cr.set_source_rgb(*palette.rgb(palette.YELLOW))
    for number in range(int((width + height) / _STRIPE_PX / 2) + 2):
        x = 2 * number * _STRIPE_PX
        cr.move_to(x, 0)
        cr.line_to(x + _STRIPE_PX, 0)
        cr.line_to(x + _STRIPE_PX - height, height)
        cr.line_to(x - height, height)
        cr.close_path()
    cr.fill()


@contextmanager
def _drawn(pixels: Pixels) -> Iterator[tuple[Context, float, float]]:
    """What draws all of these pixels, and their width and height."""
    height, width, _ = pixels.shape
    drawn = np.empty((height, width, 4), np.uint8)
    surface = cairo.ImageSurface.create_for_data(drawn.data, cairo.FORMAT_ARGB32, width, height)
    yield cairo.Context(surface), width, height
    surface.finish()
    cv2.cvtColor(drawn, cv2.COLOR_BGRA2RGBA, dst=pixels)  # cairo's order on little-endian machines

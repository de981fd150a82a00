"""The same report on A4 pages, set by matplotlib."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import matplotlib.image
import matplotlib.lines
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from tams_app.study.report.blocks import Block, Document, Listing, Paragraph, Picture, Table
from tams_app.study.report.drawing import GRID, INK

_PAGE_IN = (8.27, 11.69)
_MARGIN_IN = 0.8
_WIDTH_IN = _PAGE_IN[0] - 2 * _MARGIN_IN
_PT = 1 / 72  # [in]
_LEADING = 1.35
_TITLE_PT, _HEADING_PT, _TEXT_PT, _TABLE_PT = 18.0, 13.0, 9.0, 7.0
_CHARACTER = 0.56  # mean width of one by the size of its type, in this type and these texts
_BOLD_NARROWER = 0.84  # fewer characters fit
_ROOM_BELOW_HEADING_IN = 3.6
_CELL_GAP = 2  # characters


def write_pdf(document: Document, path: Path) -> None:
    """Write all pages; the same document gives the same bytes."""
    facts: dict[str, Any] = {"Title": document.title, "CreationDate": None}
    with PdfPages(path, metadata=facts) as pages:
        set_pages(document, pages)


def set_pages(document: Document, pages: Pages) -> None:
    """Set the document and hand over page by page."""
    setter = _Setter(pages)
    setter.text(document.title, _TITLE_PT, bold=True)
    setter.text(document.subtitle, _TEXT_PT)
    for section in document.sections:
        setter.gap(14)
        setter.keep_together(_ROOM_BELOW_HEADING_IN)
        setter.text(section.title, _HEADING_PT, bold=True)
        for block in section.blocks:
            setter.gap(5)
            _set(setter, block)
    setter.close()


def _set(setter: _Setter, block: Block) -> None:
    match block:
        case Paragraph(text, verdict):
            setter.text(text, _TEXT_PT, bold=verdict)
        case Listing(items):
            for item in items:
                setter.text(f"• {item}", _TEXT_PT, hanging="  ")
        case Table():
            _set_table(setter, block)
        case Picture(_, png, caption, _):
            setter.image(png)
            setter.text(caption, _TABLE_PT + 1)


class Pages(Protocol):
    """Takes the finished pages."""

    def savefig(self, figure: Figure) -> object: ...


class _Setter:
    """Puts lines and pictures one below the other and turns the pages."""

    def __init__(self, pages: Pages) -> None:
        self._pages = pages
        self._page = _new_page()
        self._y = _PAGE_IN[1] - _MARGIN_IN  # [in] from the foot

    def text(self, text: str, size: float, bold: bool = False, hanging: str = "") -> None:
        """A paragraph over the whole width."""
        narrower = _BOLD_NARROWER if bold else 1.0
        columns = int(_WIDTH_IN / (size * _PT * _CHARACTER) * narrower)
        for line in textwrap.wrap(text, columns, subsequent_indent=hanging):
            self.line([(0.0, line)], size, bold)

    def line(
        self,
        cells: Sequence[tuple[float, str]],
        size: float,
        bold: bool = False,
        rule: bool = False,
    ) -> None:
        """One line of texts at their distances [in] from the left margin."""
        height = size * _PT * _LEADING
        self.keep_together(height)
        self._y -= height
        for left_in, text in cells:
            x, y = (_MARGIN_IN + left_in) / _PAGE_IN[0], self._y / _PAGE_IN[1]
            weight = "bold" if bold else "normal"
            # no mathematics: a dollar sign is one
            self._page.text(x, y, text, fontsize=size, color=INK, weight=weight, parse_math=False)
        if rule:
            self._rule()

    def image(self, png: bytes) -> None:
        """A picture over the whole width."""
        pixels = matplotlib.image.imread(io.BytesIO(png))
        height = _WIDTH_IN * pixels.shape[0] / pixels.shape[1]
        self.keep_together(height)
        self._y -= height
        box = (
            _MARGIN_IN / _PAGE_IN[0],
            self._y / _PAGE_IN[1],
            _WIDTH_IN / _PAGE_IN[0],
            height / _PAGE_IN[1],
        )
        axis = self._page.add_axes(box)
        axis.imshow(pixels, aspect="auto", interpolation="none")
        axis.set_axis_off()
        self.gap(4)

    def gap(self, points: float) -> None:
        self._y -= points * _PT

    def keep_together(self, height_in: float) -> None:
        """Turn the page unless so much room is left on it."""
        if self._y - height_in < _MARGIN_IN:
            self._pages.savefig(self._page)
            self._page = _new_page()
            self._y = _PAGE_IN[1] - _MARGIN_IN

    def close(self) -> None:
        self._pages.savefig(self._page)

    def _rule(self) -> None:
        y = (self._y - 2.5 * _PT) / _PAGE_IN[1]
        ends = (_MARGIN_IN / _PAGE_IN[0], 1 - _MARGIN_IN / _PAGE_IN[0])
        line = matplotlib.lines.Line2D(
            ends, (y, y), transform=self._page.transFigure, color=GRID, linewidth=0.6
        )
        self._page.add_artist(line)


def _new_page() -> Figure:
    page = Figure(figsize=_PAGE_IN)
    FigureCanvasAgg(page)
    return page


def _set_table(setter: _Setter, table: Table) -> None:
    """Columns as wide as their longest cell asks for, in proportion; long cells are wrapped."""
    widths = _widths(table)
    height = (len(table.rows) + 5) * _TABLE_PT * _PT * _LEADING
    setter.keep_together(min(height, 4.0))
    setter.text(table.caption, _TABLE_PT + 1)
    setter.gap(2)
    _set_row(setter, table.header, widths, bold=True)
    for row in table.rows:
        _set_row(setter, row, widths, bold=False)
    setter.gap(4)


def _set_row(setter: _Setter, row: Sequence[str], widths: Sequence[int], bold: bool) -> None:
    character_in = _TABLE_PT * _PT * _CHARACTER
    lefts = [sum(widths[:place]) * character_in for place in range(len(widths))]
    narrower = _BOLD_NARROWER if bold else 1.0
    wrapped = [
        textwrap.wrap(cell, max(4, int((width - _CELL_GAP) * narrower))) or [""]
        for cell, width in zip(row, widths, strict=True)
    ]
    lines = max(len(cell) for cell in wrapped)
    for number in range(lines):
        cells = [
            (left, cell[number])
            for left, cell in zip(lefts, wrapped, strict=True)
            if number < len(cell)
        ]
        setter.line(cells, _TABLE_PT, bold, rule=number == lines - 1)


def _widths(table: Table) -> list[int]:
    """Characters per column; together the page's width."""
    room = int(_WIDTH_IN / (_TABLE_PT * _PT * _CHARACTER))
    wanted = [
        max([len(row[place]) for row in table.rows] + [min(len(title), 14)]) + _CELL_GAP
        for place, title in enumerate(table.header)
    ]
    spare = room - sum(wanted)
    return [width + spare // len(wanted) for width in wanted]

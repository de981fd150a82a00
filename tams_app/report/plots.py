"""The plot kit: how all figures look, how they are saved, and how they are put on a page.

A function that draws is decorated `@styled`: matplotlib reads its defaults as artists are made.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tams_app.outputs import made_folder, new_file

Style: TypeAlias = dict[str, Any]  # keyword arguments of matplotlib

INK, GROUND, GRID, FAINT, STOP = "#222222", "#ffffff", "#d9d9d9", "#777777", "#b00020"
BANDS, HATCH = ("#e8e8e8", "#cfcfcf"), "#bbbbbb"  # of phases, in turn; behind curves
# Of pages and of the figures in them, by the name of the CSS variable: on light and on dark ground.
# Colours of views and of the uplink (`tams_app.palette`) are seen on both.
THEME = {
    "ink": (INK, "#e6e6e6"),
    "ground": (GROUND, "#16191c"),
    "grid": (GRID, "#3a4046"),
    "faint": (FAINT, "#9aa1a8"),
    "stop": (STOP, "#ff7b7b"),
    "band": (BANDS[0], "#2a2f34"),
    "band-next": (BANDS[1], "#3d444b"),
    "hatch": (HATCH, "#555c63"),
}
DPI = 200
PAPER_IN, PAGE_IN, WIDE_IN = 7.16, 8.0, 11.0  # widths: two columns of the paper; a page; a session
TINY_PT, SMALL_PT, TEXT_PT, TITLE_PT = 7, 8, 9, 10
TIME_AXIS = "Time since session start [s]"

_DEFAULTS: Any = {
    "figure.constrained_layout.use": True,
    "font.size": TEXT_PT,
    "axes.titlesize": TITLE_PT,
    "figure.titlesize": TITLE_PT,
    "axes.labelsize": TEXT_PT,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "legend.fontsize": SMALL_PT,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.8,
    "svg.fonttype": "none",  # words, not outlines: they can be searched
    "text.parse_math": False,  # names of foreign logs are no formulas
    "svg.hashsalt": "tams",  # names by content: no random ones
} | dict.fromkeys(
    ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK
)
styled = mpl.rc_context(_DEFAULTS)


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure that needs no display."""
    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasAgg(figure)
    return figure


@dataclass(frozen=True, slots=True)
class NamedStretch:
    """A part of a session with a name, in seconds since its start."""

    name: str
    start_s: float
    end_s: float


def draw_phase_strip(axis: Axes, phases: Sequence[NamedStretch], whole_s: float) -> None:
    """A band for each phase with its name; those of short phases stand on other levels."""
    levels, last = 3, 0.94  # `last` part of the session: there a name ends where the figure does
    axis.set_ylim(0, 1)
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    for number, phase in enumerate(phases):
        axis.axvspan(phase.start_s, phase.end_s, color=BANDS[number % 2], linewidth=0)
        is_last = phase.start_s > last * whole_s
        axis.text(
            whole_s if is_last else phase.start_s,
            0.97 - number % levels / levels,
            phase.name,
            fontsize=TINY_PT,
            va="top",
            ha="right" if is_last else "left",
        )


def draw_event(axis: Axes, t_s: float, text: str, line: Style, words: Style) -> None:
    """An upright line with words at its top right."""
    axis.axvline(t_s, **line)
    if text:
        at: Style = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        axis.annotate(text, (t_s, 1.0), **{**at, "xytext": (2, -2), "va": "top", **words})


def legend_beside(figure: Figure, axis: Axes, where: str = "upper center") -> None:
    """The labels of `axis` in one row outside the panels."""
    handles, labels = axis.get_legend_handles_labels()
    at: Style = {"loc": f"outside {where}", "ncols": max(1, len(labels))}
    figure.legend(handles, labels, **at)


def save_figure(figure: Figure, path: Path) -> None:
    """Write it in the format of the suffix, the same bytes each time; TamsError if it fails."""
    made_folder(path.parent)
    with new_file(path) as file:
        _save(figure, file, path.suffix[1:].lower())


def to_png(figure: Figure) -> bytes:
    """The figure for print."""
    buffer = io.BytesIO()
    _save(figure, buffer, "png")
    return buffer.getvalue()


def to_svg(figure: Figure) -> Markup:
    """The figure as an element of a page, in the colours of the page (`THEME`).

    It has neither addresses nor names that a second figure on the page could have as well;
    matplotlib escapes the words in it.
    """
    buffer = io.StringIO()
    _save(figure, buffer, "svg", transparent=True)
    text = buffer.getvalue()
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href", "href")
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # which nothing refers to
    for name, (light, _) in THEME.items():
        text = text.replace(light, f"var(--{name})")
    return Markup(text)


@styled
def _save(figure: Figure, file: Any, form: str, **options: Any) -> None:
    undated = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}.get(form)
    figure.savefig(file, dpi=DPI, format=form, metadata=undated, **options)

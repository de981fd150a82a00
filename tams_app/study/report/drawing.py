"""How a report's figures look: colours told apart by everybody, markers besides, thin frames."""

from __future__ import annotations

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tams_app.study.report.blocks import Picture
from tams_app.study.statistics.intervals import Estimate

# Okabe and Ito's palette: told apart also with deficient colour vision
COLOURS = ("#999999", "#E69F00", "#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
MARKERS = ("s", "^", "o", "D", "v", "P", "X")
HATCHES = ("", "//", "..", "xx", "\\\\", "++", "oo")
INK = "#222222"
GRID = "#d9d9d9"
DPI = 150
WIDTH_IN = 8.0
SMALL_PT, TEXT_PT, TITLE_PT = 8, 9, 10


def new_figure(
    height_in: float, columns: int = 1, share_y: bool = True
) -> tuple[Figure, list[Axes]]:
    """A figure with one row of axes."""
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, columns, squeeze=False, sharey=share_y)[0]
    for axis in axes:
        dress(axis)
    return figure, list(axes)


def dress(axis: Axes) -> None:
    """Light grid behind the data, no frame at the top and right."""
    axis.set_axisbelow(True)
    axis.grid(axis="y", linewidth=0.5, color=GRID)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(labelsize=SMALL_PT, colors=INK)


def offsets(count: int, width: float = 0.8) -> list[float]:
    """Where `count` things stand side by side around a tick."""
    step = width / count
    return [(place - (count - 1) / 2) * step for place in range(count)]


def draw_estimate(
    axis: Axes,
    where: float,
    found: Estimate | None,
    place: int,
    label: str | None,
    across: bool = False,
) -> None:
    """A marker for strategy number `place`, its interval upright at x, or lying (`across`) at y."""
    if found is None:
        return
    error = None
    if found.low is not None and found.high is not None:
        error = [[found.value - found.low], [found.high - found.value]]
    axis.errorbar(
        *((found.value, where) if across else (where, found.value)),
        xerr=error if across else None,
        yerr=None if across else error,
        fmt=MARKERS[place % len(MARKERS)],
        color=COLOURS[place % len(COLOURS)],
        markeredgecolor=INK,
        markeredgewidth=0.5,
        ecolor=INK,
        elinewidth=0.9,
        capsize=2.5,
        markersize=6,
        label=label,
    )


def legend_above(figure: Figure, axis: Axes) -> None:
    """The labels of `axis` in one row above the figure, out of the way of the data."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=max(1, len(labels)),
        fontsize=SMALL_PT,
        frameon=False,
    )


def picture(figure: Figure, name: str, caption: str, alternative: str) -> Picture:
    """Draw the figure; the same data give the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(name, buffer.getvalue(), caption, alternative)

"""The strip below the views: phases and states, of the last minute or of a whole log.

Both drawings take a cairo context and the size of their place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from tams_app import palette
from tams_app.faces.banner import look_of
from tams_app.faces.canvas import (
    FAINT,
    GROUND,
    INK,
    PANEL,
    Context,
    fill,
    width_of,
    write,
)
from tams_app.faces.history import SPAN_S, History
from tams_app.faces.messages import Outline, Stretch

STOPS = ("holding", "fault")
_DESIGN_PX = 46  # of the height
_PHASES = 0.6  # share of the height; the states have the rest


def draw_timeline(cr: Context, width: float, height: float, history: History) -> None:
    """The last minute: a row of phases, below it one of states; now is at the right."""
    fill(cr, PANEL, 0, 0, width, height)
    if not history.states:
        return
    now_s = history.states[-1].t_s
    _draw_rows(
        cr,
        (width, height),
        (
            history.stretches(lambda state: state.phase),
            history.stretches(lambda state: state.arming),
        ),
        now_s,
        lambda t_s: width * (1 + (t_s - now_s) / SPAN_S),
    )


def draw_log(cr: Context, width: float, height: float, outline: Outline, t_s: float) -> None:
    """A whole log in the same rows, with a mark where it stopped and a line at `t_s`."""

    def x_of(t_s: float) -> float:
        return width * t_s / outline.end_s

    fill(cr, PANEL, 0, 0, width, height)
    _draw_rows(cr, (width, height), (outline.phases, outline.states), t_s, x_of)
    for stretch in outline.states:
        if stretch.what in STOPS:
            _draw_mark(cr, x_of(stretch.begin_s), height, look_of(stretch.what).colour)
    x = min(max(x_of(t_s), 1.5), width - 1.5)
    fill(cr, GROUND, x - 2.5, 0, 5, height)
    fill(cr, INK, x - 1.5, 0, 3, height)


def _draw_rows(
    cr: Context,
    size: tuple[float, float],
    rows: tuple[Sequence[Stretch], Sequence[Stretch]],
    now_s: float,
    x_of: Callable[[float], float],
) -> None:
    """Phases and, below them, states; the name of the phase at `now_s` is always there."""
    width, height = size
    phases, states = rows
    scale, split = height / _DESIGN_PX, height * _PHASES
    begun = sum(stretch.begin_s <= now_s for stretch in phases)
    for number, stretch in enumerate(phases):
        x, end = x_of(stretch.begin_s), x_of(stretch.end_s)
        fill(cr, ("#39434C", "#2B333A")[number % 2], x, 1, end - x, split)
        _name(cr, [stretch.what], x, end, split - 8 * scale, INK, 14 * scale)
        fill(cr, FAINT, x, 1, 1, split)
    for stretch in phases[begun - 1 : begun]:
        needed = width_of(cr, stretch.what, 14 * scale, bold=True) + 12
        x = min(x_of(stretch.begin_s), width - needed)
        end = max(x_of(stretch.end_s), x + needed)
        fill(cr, "#E4E8EB", x, 1, end - x, split)
        _name(cr, [stretch.what], x, end, split - 8 * scale, GROUND, 14 * scale)
        fill(cr, FAINT, x, 1, 1, split)
    for stretch in states:
        x, end = x_of(stretch.begin_s), x_of(stretch.end_s)
        look = look_of(stretch.what)
        fill(cr, look.colour, x, split + 2, max(end - x, 2), height - split - 3)
        words = [f"{look.sign} {look.word}", look.sign]
        _name(cr, words, x, end, height - 4.5 * scale, look.ink, 11 * scale)


def _name(
    cr: Context, words: Sequence[str], x: float, end: float, y: float, colour: str, size: float
) -> None:
    """The first of `words` that there is room for within a stretch, if any.

    A stretch that is longer than its name keeps it in sight as it moves to the left.
    """
    x = max(x, 0.0)
    for text in words:
        if end - x >= width_of(cr, text, size, bold=True) + 10:
            write(cr, text, x + 5, y, colour, size, bold=True)
            return


def _draw_mark(cr: Context, x: float, height: float, colour: str) -> None:
    """An arrowhead between the rows, below the names, that points at the begin of a state."""
    tip, size = height * _PHASES + 2, height / 6
    for mark, margin in ((GROUND, 3.0), (INK, 1.5), (colour, 0.0)):
        cr.set_source_rgb(*palette.rgb(mark))
        cr.move_to(x - size / 2 - margin, tip - size - margin)
        cr.line_to(x + size / 2 + margin, tip - size - margin)
        cr.line_to(x, tip + margin)
        cr.close_path()
        cr.fill()

"""The last minute, and the strip below the views that shows phases and states of it or of a log.

Both drawings take a cairo context and the size of their place.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise
from operator import itemgetter

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
from tams_app.faces.messages import SPAN_S, FaceFacts, Outline, Stretch
from tams_app.records import SessionState

STOPS = ("holding", "fault")
_DESIGN_PX = 46  # of the height
_PHASES = 0.6  # share of the height; the states have the rest


class History:
    """The states of the last SPAN_S seconds."""

    def __init__(self) -> None:
        self.states: deque[SessionState] = deque()
        self._jumps = 0

    def add(self, facts: FaceFacts) -> None:
        """Take in a newer state; one of the same moment changes nothing.

        Where a replay goes back, what came later is forgotten; where it jumps, the minute before
        is what its log has, or, if it does not tell, is forgotten after a jump ahead.
        """
        states, state, jumps = self.states, facts.state, _jumps(facts)
        jumped, self._jumps = jumps != self._jumps, jumps
        if states and state.t_s == states[-1].t_s:
            return
        if jumped and facts.replay is not None and facts.replay.past:
            states.clear()
            states.extend(facts.replay.past)
        elif states and state.t_s > states[-1].t_s and jumped:
            states.clear()
        while states and states[-1].t_s >= state.t_s:
            states.pop()
        states.append(state)
        while states[0].t_s < state.t_s - SPAN_S:
            states.popleft()


def _jumps(facts: FaceFacts) -> int:
    return 0 if facts.replay is None else facts.replay.jumps


def stretches(words: Iterable[tuple[float, str]]) -> list[Stretch]:
    """The times in which a word stayed the same, one after the other; of moments [s] in order."""
    words = list(words)
    begins = [next(group) for _, group in groupby(words, itemgetter(1))]
    changes = pairwise([*begins, *words[-1:]])
    return [Stretch(begin_s, end_s, word) for (begin_s, word), (end_s, _) in changes]


def draw_timeline(cr: Context, width: float, height: float, states: Sequence[SessionState]) -> None:
    """The last minute: a row of phases, below it one of states; now is at the right."""
    fill(cr, PANEL, 0, 0, width, height)
    if not states:
        return
    now_s = states[-1].t_s
    phases = stretches((state.t_s, state.phase) for state in states)
    arming = stretches((state.t_s, state.arming) for state in states)
    _draw_rows(cr, (width, height), (phases, arming), now_s, (now_s - SPAN_S, SPAN_S))


def draw_log(cr: Context, width: float, height: float, outline: Outline, t_s: float) -> None:
    """A whole log in the same rows, with a mark where it stopped and a line at `t_s`."""
    span = 0.0, outline.end_s
    fill(cr, PANEL, 0, 0, width, height)
    _draw_rows(cr, (width, height), (outline.phases, outline.states), t_s, span)
    for stretch in outline.states:
        if stretch.what in STOPS:
            x = _x_of(stretch.begin_s, width, span)
            _draw_mark(cr, x, height, look_of(stretch.what).colour)
    x = min(max(_x_of(t_s, width, span), 1.5), width - 1.5)
    fill(cr, GROUND, x - 2.5, 0, 5, height)
    fill(cr, INK, x - 1.5, 0, 3, height)


def _x_of(t_s: float, width: float, span: tuple[float, float]) -> float:
    """The place of a moment; `span`: begin and length [s] of what is shown."""
    begin_s, length_s = span
    return width * (t_s - begin_s) / length_s


def _draw_rows(
    cr: Context,
    size: tuple[float, float],
    rows: tuple[Sequence[Stretch], Sequence[Stretch]],
    now_s: float,
    span: tuple[float, float],
) -> None:
    """Phases and, below them, states; the name of the phase at `now_s` is always there.

    `span`: as for `_x_of`.
    """
    width, height = size
    phases, states = rows
    scale, split = height / _DESIGN_PX, height * _PHASES
    begun = sum(stretch.begin_s <= now_s for stretch in phases)
    for number, stretch in enumerate(phases):
        x, end = (_x_of(t_s, width, span) for t_s in (stretch.begin_s, stretch.end_s))
        fill(cr, ("#39434C", "#2B333A")[number % 2], x, 1, end - x, split)
        _name(cr, [stretch.what], x, end, split - 8 * scale, INK, 14 * scale)
        fill(cr, FAINT, x, 1, 1, split)
    for stretch in phases[begun - 1 : begun]:
        needed = width_of(cr, stretch.what, 14 * scale, bold=True) + 12
        x = min(_x_of(stretch.begin_s, width, span), width - needed)
        end = max(_x_of(stretch.end_s, width, span), x + needed)
        fill(cr, "#E4E8EB", x, 1, end - x, split)
        _name(cr, [stretch.what], x, end, split - 8 * scale, GROUND, 14 * scale)
        fill(cr, FAINT, x, 1, 1, split)
    for stretch in states:
        x, end = (_x_of(t_s, width, span) for t_s in (stretch.begin_s, stretch.end_s))
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

"""The drawings of the window: rates over time, the table, the arm from above, the hand.

Each takes a cairo context and the size of its place; sizes within are in units that grow with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from tams_app import palette
from tams_app.faces.banner import look_of
from tams_app.faces.messages import SPAN_S, ShownWorkspace
from tams_app.faces.shown import HEADINGS, ShownState
from tams_app.records import SessionState

GROUND, PANEL = "#101418", "#1B2127"
INK, FAINT, LINE = "#F2F4F5", "#A9B2BA", "#3A434B"
_TEXT_PX = 13.0
_COLUMNS = (0.0, 0.09, 0.36, 0.51, 0.64, 0.77)  # of the table, as shares of its width

Context = Any  # cairo.Context: introspection hands it over


def fill(cr: Context, colour: str, x: float, y: float, width: float, height: float) -> None:
    """A filled rectangle."""
    cr.set_source_rgb(*palette.rgb(colour))
    cr.rectangle(x, y, width, height)
    cr.fill()


def write(
    cr: Context,
    text: str,
    x: float,
    y: float,
    colour: str = INK,
    size: float = _TEXT_PX,
    bold: bool = False,
) -> None:
    """Text whose base line begins at `x`, `y`."""
    cr.select_font_face("sans-serif", 0, 1 if bold else 0)
    cr.set_font_size(size)
    cr.set_source_rgb(*palette.rgb(colour))
    cr.move_to(x, y)
    cr.show_text(text)


def width_of(cr: Context, text: str, size: float = _TEXT_PX, bold: bool = False) -> float:
    """The width that `write` takes."""
    cr.select_font_face("sans-serif", 0, 1 if bold else 0)
    cr.set_font_size(size)
    return float(cr.text_extents(text).x_advance)


def draw_rates(
    cr: Context, width: float, height: float, states: Sequence[SessionState], views: Sequence[str]
) -> None:
    """Measured rate of each view as a line, its target dashed, the capacity estimate grey."""
    fill(cr, PANEL, 0, 0, width, height)
    scale = width / 540
    left, right, top, bottom = 44 * scale, 44 * scale, 25 * scale, 6 * scale
    legend = "kbit/s, last minute: sent ——  target - -  capacity, estimated — —"
    write(cr, legend, 6, 15 * scale, FAINT, 12 * scale)
    if not states:
        return
    now_s = states[-1].t_s
    lines = [
        (
            palette.view_colour(place),
            view.upper(),
            _known((state.t_s, state.views[view].sent_kbps) for state in states),
            _known((state.t_s, state.views[view].target_kbps) for state in states),
        )
        for place, view in enumerate(views)
    ]
    capacity = _known((state.t_s, state.estimate_kbps) for state in states)
    most = max((kbps for _, _, sent, target in lines for _, kbps in (*sent, *target)), default=0.0)
    ceiling = _ceiling(max(most * 1.1, 500.0))
    width_px, height_px = width - left - right, height - top - bottom

    def place_of(point: tuple[float, float]) -> tuple[float, float]:
        t_s, kbps = point
        share = min(kbps / ceiling, 1.02)
        return left + width_px * (1 + (t_s - now_s) / SPAN_S), top + height_px * (1 - share)

    for share in (0.0, 0.5, 1.0):
        y = top + height_px * (1 - share)
        fill(cr, LINE, left, y, width_px, 1)
        label = f"{ceiling * share:.0f}"
        size = 11 * scale
        write(cr, label, left - 5 - width_of(cr, label, size), y + 4 * scale, FAINT, size)
    long_dashes = (8 * scale, 4 * scale)
    points = [place_of(point) for point in capacity]
    _curve(cr, points, palette.CAPACITY_ESTIMATE, 1.4 * scale, long_dashes)
    names: list[tuple[float, str, str]] = []
    for colour, name, sent, target in lines:
        _curve(
            cr, [place_of(point) for point in target], colour, 1.4 * scale, (4 * scale, 3 * scale)
        )
        _curve(cr, [place_of(point) for point in sent], colour, 2.2 * scale, ())
        if known := sent or target:
            names.append((place_of(known[-1])[1] + 4 * scale, name, colour))
    names.sort(reverse=True)  # from below, so that they stand in the order of their curves
    for y, (_, name, colour) in zip(apart([y for y, *_ in names], 13 * scale), names, strict=True):
        fill(cr, colour, width - right + 4, y - 9 * scale, 4 * scale, 10 * scale)
        write(cr, name, width - right + 11 * scale, y, INK, 12 * scale, bold=True)


def _known(curve: Iterable[tuple[float, float | None]]) -> list[tuple[float, float]]:
    """A value over time [s], where it is known."""
    return [(t_s, value) for t_s, value in curve if value is not None]


def _curve(
    cr: Context,
    points: Sequence[tuple[float, float]],
    colour: str,
    thickness: float,
    dashes: tuple[float, ...],
) -> None:
    if len(points) < 2:
        return
    cr.set_source_rgb(*palette.rgb(colour))
    cr.set_line_width(thickness)
    cr.set_dash(dashes)
    cr.move_to(*points[0])
    for point in points[1:]:
        cr.line_to(*point)
    cr.stroke()
    cr.set_dash(())


def apart(places: Sequence[float], distance: float) -> list[float]:
    """The places from below, each moved up by what it lacks of `distance` to the one before."""
    found: list[float] = []
    for y in places:
        found.append(min(y, found[-1] - distance) if found else y)
    return found


def _ceiling(kbps: float) -> float:
    """A round number that is no less."""
    unit = 10 ** math.floor(math.log10(kbps))
    return float(
        next(step * unit for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * unit >= kbps)
    )


def draw_table(
    cr: Context, width: float, height: float, shown: ShownState, views: Sequence[str]
) -> None:
    """The numbers of each view, and below them the uplink's, and what delays the primary view."""
    fill(cr, PANEL, 0, 0, width, height)
    rows = len(views) + 4
    step = height / (rows + 0.3)
    size = min(step * 0.72, width / 38)
    for heading, column in zip(HEADINGS, _COLUMNS, strict=True):
        write(cr, heading, 8 + column * (width - 12), step * 0.85, FAINT, size * 0.88)
    for number, (view, row) in enumerate(zip(views, shown.rows, strict=True)):
        y = step * (number + 1.9)
        is_primary = view == shown.state.primary_view
        if is_primary:
            fill(cr, "#2F3A43", 0, y - step * 0.76, width, step)
        fill(cr, palette.view_colour(number), 0, y - step * 0.76, 5, step)
        for cell, column in zip(row, _COLUMNS, strict=True):
            write(cr, cell, 8 + column * (width - 12), y, INK, size, bold=is_primary)
    for number, text in enumerate(shown.uplink):
        y = step * (len(views) + 2.0 + 0.95 * number)
        write(cr, text, 8, y, INK if number else FAINT, size)


def draw_hand(cr: Context, width: float, height: float, shown: ShownState) -> None:
    """Deadman, mode, gripper, buttons and where the TCP is."""
    fill(cr, PANEL, 0, 0, width, height)
    step = height / (len(shown.hand) + 0.2)
    size = min(step * 0.68, width / 17)
    for number, (name, word) in enumerate(shown.hand):
        y = step * (number + 0.75)
        held = number == 0 and shown.state.deadman is True
        if held:
            fill(
                cr, look_of("engaged").colour, width * 0.36 - 6, y - size, width * 0.6, size * 1.35
            )
        write(cr, name, 8, y, FAINT, size)
        write(cr, word, width * 0.36, y, INK, size, bold=held)


def draw_workspace(
    cr: Context, width: float, height: float, workspace: ShownWorkspace, state: SessionState
) -> None:
    """The arm's workspace from above, x up and y to the left, and at the side the TCP's height."""
    fill(cr, PANEL, 0, 0, width, height)
    (low_x, low_y, low_z), (high_x, high_y, high_z) = workspace.box_min_mm, workspace.box_max_mm
    unit = height / 124
    beam = 30.0 * unit
    back = min(low_x, 0.0) - 20
    scale = min((width - beam - 14) / (high_y - low_y), (height - 14) / (high_x - back))
    middle = (width - beam) / 2

    def place_of(x_mm: float, y_mm: float) -> tuple[float, float]:
        return middle - (y_mm - (low_y + high_y) / 2) * scale, 7 + (high_x - x_mm) * scale

    x, y = place_of(high_x, high_y)
    box = (x, y, (high_y - low_y) * scale, (high_x - low_x) * scale)
    base = place_of(0, 0)
    cr.save()
    cr.rectangle(*box)
    cr.clip()
    cr.set_source_rgb(*palette.rgb("#33404A"))
    cr.arc(*base, workspace.radius_max_mm * scale, 0, 2 * math.pi)
    cr.arc_negative(*base, workspace.radius_min_mm * scale, 2 * math.pi, 0)
    cr.fill()
    cr.restore()
    cr.set_source_rgb(*palette.rgb(FAINT))
    cr.set_line_width(1.0)
    cr.rectangle(*box)
    cr.stroke()
    fill(cr, FAINT, base[0] - 5, base[1] - 5, 10, 10)
    fill(cr, LINE, width - beam, 7, 12 * unit, height - 14)
    write(cr, "z", width - beam + 15 * unit, 7 + 9 * unit, FAINT, 11 * unit)
    if state.tcp_mm is None:
        return
    tcp = place_of(state.tcp_mm[0], state.tcp_mm[1])
    cr.set_source_rgb(*palette.rgb(INK))
    cr.set_line_width(3.0)
    cr.move_to(*base)
    cr.line_to(*tcp)
    cr.stroke()
    look = look_of(state.arming)
    cr.set_source_rgb(*palette.rgb(look.colour))
    cr.arc(*tcp, 7, 0, 2 * math.pi)
    cr.fill_preserve()
    cr.set_source_rgb(*palette.rgb(INK))
    cr.set_line_width(2.0)
    cr.stroke()
    share = (state.tcp_mm[2] - low_z) / (high_z - low_z)
    level = 7 + (height - 14) * (1 - min(max(share, 0.0), 1.0))
    fill(cr, INK, width - beam - 3, level - 2, 12 * unit + 6, 4)

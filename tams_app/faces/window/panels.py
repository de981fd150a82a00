"""The parts of the window beside the views: banner, numbers, time line, episodes, list of keys."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from msgspec.structs import replace

from tams_app.faces import canvas
from tams_app.faces.banner import Banner
from tams_app.faces.messages import Ended, Outline, ShownWorkspace
from tams_app.faces.shown import ShownState
from tams_app.faces.window import strips
from tams_app.faces.window.strips import History
from tams_app.faces.window.style import EDGES
from tams_app.faces.window.toolkit import load


def framed(inside: Any) -> Any:
    """`inside` within the border that tells the state.

    Each edge is a widget of its own: of one border around all, GTK draws all but a solid one as a
    picture as large as the window, which in software takes a quarter of a second.
    """
    Gtk = load().Gtk
    frame = Gtk.Grid()
    frame.attach(inside, 1, 1, 1, 1)
    places = ((0, 0, 3, 1), (0, 1, 1, 1), (2, 1, 1, 1), (0, 2, 3, 1))
    for side, place in zip(EDGES, places, strict=True):
        edge = Gtk.Box()
        edge.add_css_class("edge")
        edge.add_css_class(f"edge-{side}")
        frame.attach(edge, *place)
    return frame


class BannerPanel:
    """State, reason, what helps, and the button that stops the arm or, of a replay, the time."""

    def __init__(self) -> None:
        Gtk = load().Gtk
        self.widget = Gtk.Box(spacing=8)
        self.widget.add_css_class("banner")
        self._sign, self._word = _label("sign"), _label("word")
        self._sentence = _label("sentence", wrap=True, lines=2)
        self._key = _label("key")
        texts = Gtk.Box(orientation=Gtk.Orientation.VERTICAL, hexpand=True, valign=Gtk.Align.CENTER)
        texts.append(self._sentence)
        texts.append(self._key)
        # never the focus: Space and Enter mean what they mean wherever one clicked before
        self.button = Gtk.Button(label="STOP", focusable=False, focus_on_click=False)
        self.button.add_css_class("act")
        for part in (self._sign, self._word, texts, self.button):
            self.widget.append(part)

    def show(self, banner: Banner) -> None:
        self._sign.set_text(banner.look.sign)
        self._word.set_text(banner.look.word)
        self._sentence.set_text(banner.sentence)
        self._key.set_text(banner.key)
        self.button.set_label(banner.button)
        if banner.button == "STOP":
            self.button.add_css_class("stop")
        else:  # nothing that stops an arm
            self.button.remove_css_class("stop")


class NumbersPanel:
    """Rates over time, the table, the workspace from above, and what the hand does."""

    def __init__(self, views: tuple[str, ...], workspace: ShownWorkspace, history: History) -> None:
        Gtk = load().Gtk
        self._views, self._workspace, self._history = views, workspace, history
        self._shown: ShownState | None = None
        draws = (self._draw_rates, self._draw_table, self._draw_workspace, self._draw_hand)
        self._areas = rates, table, above, hand = [_area(draw) for draw in draws]
        self.widget = Gtk.Grid(
            row_homogeneous=True,
            column_homogeneous=True,
            row_spacing=4,
            column_spacing=4,
            hexpand=True,
            vexpand=True,
        )
        self.widget.attach(rates, 0, 0, 2, 6)
        self.widget.attach(table, 0, 6, 2, 7)
        self.widget.attach(above, 0, 13, 1, 7)
        self.widget.attach(hand, 1, 13, 1, 7)

    def show(self, shown: ShownState) -> None:
        self._shown = shown
        for area in self._areas:
            area.queue_draw()

    def _draw_rates(self, cr: Any, width: float, height: float) -> None:
        canvas.draw_rates(cr, width, height, self._history.states, self._views)

    def _draw_table(self, cr: Any, width: float, height: float) -> None:
        if self._shown is not None:
            canvas.draw_table(cr, width, height, self._shown, self._views)

    def _draw_workspace(self, cr: Any, width: float, height: float) -> None:
        if self._shown is not None:
            canvas.draw_workspace(cr, width, height, self._workspace, self._shown.state)

    def _draw_hand(self, cr: Any, width: float, height: float) -> None:
        if self._shown is not None:
            canvas.draw_hand(cr, width, height, self._shown)


class TrialPanel:
    """In place of the numbers where they reveal too much: in a trial, and to who marks one."""

    def __init__(self, workspace: ShownWorkspace) -> None:
        Gtk = load().Gtk
        self._workspace = workspace
        self._shown: ShownState | None = None
        self.widget = Gtk.Box(
            orientation=Gtk.Orientation.VERTICAL, spacing=10, hexpand=True, vexpand=True
        )
        card = Gtk.Box(orientation=Gtk.Orientation.VERTICAL, spacing=6)
        card.add_css_class("trial")
        self._labels = [_label("who"), *(_label("") for _ in range(4))]
        for label in self._labels:
            card.append(label)
        self.widget.append(card)
        self._area = _area(self._draw)
        self.widget.append(self._area)

    def show(self, shown: ShownState) -> None:
        self._shown = shown
        _write(self._labels, shown.card)
        self._area.queue_draw()

    def _draw(self, cr: Any, width: float, height: float) -> None:
        if (shown := self._shown) is not None:
            canvas.draw_workspace(cr, width / 2 - 2, height, self._workspace, shown.state)
            cr.translate(width / 2 + 2, 0)
            canvas.draw_hand(cr, width / 2 - 2, height, shown)


class Timeline:
    """Phases and states of the last minute, over the whole width."""

    def __init__(self, history: History) -> None:
        self._history = history
        self.widget = _area(self._draw, expands=False)

    def set_height(self, height_px: int) -> None:
        self.widget.set_content_height(height_px)

    def show(self, _shown: ShownState) -> None:
        self.widget.queue_draw()

    def _draw(self, cr: Any, width: float, height: float) -> None:
        strips.draw_timeline(cr, width, height, self._history.states)


class LogBar:
    """Of a replay, in place of the time line: its place in the whole log, which a click changes."""

    def __init__(self, outline: Outline, seek: Callable[[float], None]) -> None:
        """`seek` is called with the moment of the log [s] that was clicked or dragged to."""
        Gtk = load().Gtk
        self._outline, self._t_s, self._seek = outline, 0.0, seek
        self._texts = [_label("position"), _label("")]
        words = Gtk.Box(orientation=Gtk.Orientation.VERTICAL, valign=Gtk.Align.CENTER)
        words.add_css_class("replay")
        for label in self._texts:
            words.append(label)
        self._area = _area(self._draw, expands=False)
        self._area.set_cursor_from_name("pointer")
        drag = Gtk.GestureDrag()
        drag.connect("drag-begin", self._clicked)
        drag.connect("drag-update", self._dragged)
        self._area.add_controller(drag)
        self.widget = Gtk.Box(spacing=4)
        self.widget.append(words)
        self.widget.append(self._area)

    def set_height(self, height_px: int) -> None:
        self._area.set_content_height(height_px)

    def show(self, shown: ShownState) -> None:
        self._t_s = shown.state.t_s
        if shown.marks is not None:
            self._outline = replace(self._outline, phases=shown.marks)
        _write(self._texts, shown.position)
        self._area.queue_draw()

    def _draw(self, cr: Any, width: float, height: float) -> None:
        strips.draw_log(cr, width, height, self._outline, self._t_s)

    def _clicked(self, _drag: Any, x: float, _y: float) -> None:
        self._seek(self._at(x))

    def _dragged(self, drag: Any, x: float, _y: float) -> None:
        self._seek(self._at(drag.get_start_point().x + x))

    def _at(self, x: float) -> float:
        """The moment [s] at a place in the bar."""
        return self._outline.end_s * min(max(x / float(self._area.get_width()), 0.0), 1.0)


class EpisodeStrip:
    """One row below the time line; not there in a session without episodes."""

    def __init__(self) -> None:
        Gtk = load().Gtk
        self.widget = Gtk.Box(spacing=24, visible=False)
        self.widget.add_css_class("episodes")
        self._labels = [Gtk.Label(xalign=0.0, ellipsize=3) for _ in range(5)]
        self._labels[0].add_css_class("running")
        self._labels[1].add_css_class("asked")
        self._labels[2].add_css_class("means")
        self._labels[3].set_hexpand(True)
        for label in self._labels:
            self.widget.append(label)

    def show(self, shown: ShownState) -> None:
        self.widget.set_visible(bool(shown.episodes))
        _write(self._labels, shown.episodes)
        for label, text in zip(self._labels, shown.episodes, strict=False):
            label.set_visible(bool(text) or label.get_hexpand())


class EndPanel:
    """What came of the session, over everything else; hidden until it is over."""

    def __init__(self) -> None:
        Gtk = load().Gtk
        self.widget = Gtk.Box(
            orientation=Gtk.Orientation.VERTICAL,
            spacing=4,
            halign=Gtk.Align.CENTER,
            valign=Gtk.Align.CENTER,
            visible=False,
        )
        self.widget.add_css_class("end")
        self._end: Ended | None = None

    def show(self, end: Ended | None) -> None:
        if end is None or end == self._end:
            return
        self._end = end
        while (child := self.widget.get_first_child()) is not None:
            self.widget.remove(child)
        self.widget.append(_label("who", text=end.headline, wrap=True, lines=2))
        for line in end.lines:
            label = _label("", text=line, wrap=True, lines=3)
            label.set_selectable(True)  # a path or a command can be copied
            label.set_focusable(False)
            self.widget.append(label)
        self.widget.append(_label("key", text=end.key))
        self.widget.set_visible(True)


def key_list(keys: Sequence[tuple[str, str]]) -> Any:
    """All keys and what they do; hidden at first."""
    Gtk = load().Gtk
    grid = Gtk.Grid(halign=Gtk.Align.CENTER, valign=Gtk.Align.CENTER, visible=False)
    grid.add_css_class("keys")
    for row, (key, meaning) in enumerate(keys):
        grid.attach(_label("name", text=key), 0, row, 1, 1)
        grid.attach(_label("", text=meaning), 1, row, 1, 1)
    return grid


def _label(css_class: str, text: str = "", wrap: bool = False, lines: int = 1) -> Any:
    Gtk = load().Gtk
    label = Gtk.Label(label=text, xalign=0.0, wrap=wrap, lines=lines)
    label.set_ellipsize(3)  # PANGO_ELLIPSIZE_END: what is too long makes nothing else move
    if css_class:
        label.add_css_class(css_class)
    return label


def _write(labels: Sequence[Any], texts: Sequence[str]) -> None:
    """Write each into its label; none where there are none."""
    for label, text in zip(labels, texts, strict=bool(texts)):
        label.set_text(text)


def _area(draw: Callable[[Any, float, float], None], expands: bool = True) -> Any:
    area = load().Gtk.DrawingArea(hexpand=True, vexpand=expands)
    area.set_draw_func(lambda _area, cr, width, height, *_: draw(cr, width, height))
    return area

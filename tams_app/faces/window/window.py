"""The window as a whole: what is where, what its keys do, and when it draws."""

from __future__ import annotations

import threading
import time
from typing import Any

from msgspec.structs import replace

from tams_app.faces.application import Application, Opened
from tams_app.faces.commands import Command
from tams_app.faces.messages import BEAT_S, CommandRequest, FaceFacts, Keys, Pin, Seek
from tams_app.faces.shown import shown_of, view_title
from tams_app.faces.views import Corrected, DrawPacer, Places
from tams_app.faces.window.keyboard import Keyboard, Symbol, command_of, key_help, key_name
from tams_app.faces.window.panels import (
    BannerPanel,
    EndPanel,
    EpisodeStrip,
    LogBar,
    NumbersPanel,
    Timeline,
    TrialPanel,
    framed,
    key_list,
)
from tams_app.faces.window.picture import Arrivals, PicturePlace, texture_of
from tams_app.faces.window.sight import Sight
from tams_app.faces.window.strips import History
from tams_app.faces.window.style import (
    DESIGN_HEIGHT,
    LIVE_CLASS,
    SILENT_CLASS,
    state_class,
    style_sheet,
    view_class,
)
from tams_app.faces.window.toolkit import Size, load
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS
from tams_app.video.core.stages import DISPLAY, StageMeans, together

TITLE = "TAMS"
LOOK_MS = 8  # for new frames
_NOT_LOOKING_NS = 200 * NS_PER_MS
_FIGURES_NS = 200 * NS_PER_MS  # between drawings of what is no picture
_TIMELINE_PX, _GAP_PX = 48, 4


class OperatorWindow:
    """Shows what was opened, and reports what the operator does."""

    def __init__(
        self,
        opened: Opened,
        application: Application,
        clock: Clock,
        size: Size,
    ) -> None:
        self._modules = load()
        self._opening = opening = opened.opening
        self._textures: dict[str, Any] = {}
        self._corrected = Corrected(opened.present, opened.frames, clock)
        self._facts = opened.facts
        self._shown: FaceFacts | None = None  # as they may be shown
        self._application, self._clock = application, clock
        self._keyboard = Keyboard()
        self._is_replay = opening.replay is not None
        self._places = Places(opening.views)
        self._arrivals = Arrivals(opened.frames, self._places.large)
        self._pacer = DrawPacer(clock.now_ns(), time.process_time_ns())
        self._display = StageMeans()  # of the large picture
        self._put_ns = 0  # when the frame was put that it shows, and that is not drawn yet
        self._history = History()
        # GTK paints at PRIORITY_HIGH_IDLE + 20; looks that are more urgent leave it no time
        self._after_paints = self._modules.GLib.PRIORITY_HIGH_IDLE + 30
        self._drawings = self._shade = 0
        self._figures_ns = 0
        self._looked_ns = clock.now_ns()
        self._classes: list[str] = []  # of the frame
        self._scale = 0.0
        self._build(size)
        self._listen()

    def present(self) -> None:
        """Show it, and begin to look for what is new."""
        GLib = self._modules.GLib
        self.window.present()
        GLib.timeout_add(LOOK_MS, self._look, priority=self._after_paints)
        after_keys = GLib.PRIORITY_DEFAULT + 1  # what the desktop has sent is taken in before
        GLib.timeout_add(round(BEAT_S * 1000), self._beat, priority=after_keys)

    @property
    def size(self) -> Size:
        """As it is now; what is maximised keeps the size that it had before."""
        width, height = self.window.get_default_size()
        return Size(width, height, self.window.is_maximized())

    # --- what is where --------------------------------------------------------------------------

    def _build(self, size: Size) -> None:
        Gtk, Gdk = self._modules.Gtk, self._modules.Gdk
        title = f"{TITLE} replay" if self._is_replay else TITLE
        self.window = Gtk.Window(title=title, default_width=size.width, default_height=size.height)
        self.window.connect("realize", self._realized)
        if size.maximised:
            self.window.maximize()
        self._css = Gtk.CssProvider()
        Gtk.StyleContext.add_provider_for_display(
            Gdk.Display.get_default(), self._css, Gtk.STYLE_PROVIDER_PRIORITY_APPLICATION
        )
        self._banner = BannerPanel()
        self._banner.button.connect("clicked", self._clicked)
        self._pictures = [PicturePlace() for _ in self._opening.views]
        workspace, views = self._opening.workspace, self._opening.views
        self._panel: NumbersPanel | TrialPanel = (
            TrialPanel(workspace)
            if self._opening.blind
            else NumbersPanel(views, workspace, self._history)
        )
        self._timeline: Timeline | LogBar = (
            Timeline(self._history)
            if self._opening.replay is None
            else LogBar(self._opening.replay, self._seek)
        )
        self._notice = Gtk.Label(xalign=0.0, ellipsize=3, hexpand=True)
        self._status = Gtk.Label(xalign=1.0)
        self._status.add_css_class("status")
        notices = Gtk.Box(spacing=12)
        notices.add_css_class("said")
        notices.append(self._notice)
        notices.append(self._status)
        inside = Gtk.Box(orientation=Gtk.Orientation.VERTICAL, spacing=_GAP_PX)
        self._frame = framed(inside)
        main = self._main_part()
        self._episodes = EpisodeStrip()
        below = (self._timeline.widget, self._episodes.widget, notices)
        for part in (self._banner.widget, main, *below):
            inside.append(part)
        for part in (main, self._timeline.widget):
            part.add_css_class(LIVE_CLASS)
        self._keys = key_list(key_help(self._opening))
        one, first = {"content_width": 1, "content_height": 1}, Gtk.Align.START
        self._pixel = Gtk.DrawingArea(**one, halign=first, valign=first, can_target=False)
        self._pixel.set_draw_func(self._draw_pixel)
        overlay = Gtk.Overlay(child=self._frame)
        overlay.add_overlay(self._keys)
        self._end = EndPanel()
        overlay.add_overlay(self._end.widget)
        overlay.add_overlay(self._pixel)
        self.window.set_child(overlay)
        self._adapt()
        self._show_places()

    def _main_part(self) -> Any:
        """The large view at the left, the others and the numbers at the right."""
        Gtk = self._modules.Gtk
        same = {"row_homogeneous": True, "column_homogeneous": True}
        gaps = {"row_spacing": _GAP_PX, "column_spacing": _GAP_PX}
        main = Gtk.Grid(**same, **gaps, hexpand=True, vexpand=True)
        main.attach(self._pictures[0].widget, 0, 0, 7, 20)
        others = self._pictures[1:]
        columns = min(len(others), 2)
        rows = -(-len(others) // 2)
        if others:
            small = Gtk.Grid(**same, **gaps)
            for number, picture in enumerate(others):
                small.attach(picture.widget, number % columns, number // columns, 1, 1)
            main.attach(small, 7, 0, 5, 7 * rows)
        main.attach(self._panel.widget, 7, 7 * rows, 5, max(20 - 7 * rows, 6))
        return main

    def _adapt(self) -> None:
        """Let texts and strips grow with the window."""
        height = self.window.get_height() or self.window.get_default_size()[1]
        scale = round(max(height / DESIGN_HEIGHT, 0.6), 2)
        if scale != self._scale:
            self._scale = scale
            self._css.load_from_data(style_sheet(scale))
            self._timeline.set_height(round(_TIMELINE_PX * scale))

    # --- keys -----------------------------------------------------------------------------------

    def _listen(self) -> None:
        Gtk = self._modules.Gtk
        keys = Gtk.EventControllerKey(propagation_phase=Gtk.PropagationPhase.CAPTURE)
        keys.connect("key-pressed", self._pressed)
        keys.connect("key-released", self._released)
        self.window.add_controller(keys)
        self._seat = self._modules.Gdk.Display.get_default().get_default_seat()
        if (keyboard := self._seat.get_keyboard()) is not None:
            keyboard.connect("notify::modifier-state", self._beat)
        self.window.connect("notify::is-active", self._beat)
        self.window.connect("close-request", self._closed)

    def _pressed(self, keys: Any, value: int, code: int, _modifiers: Any) -> bool:
        name = self._name(code, keys.get_current_event().get_layout())
        symbol = self._modules.Gdk.keyval_name(value) or ""
        # what types a space or an escape stops the arm, whichever key does and is called
        stop = command_of(name, False, self._is_replay) or command_of(
            symbol, False, self._is_replay
        )
        if stop is not None:
            self._ask(stop)
        self._beat()  # a key that waited while this process stood still is no new press
        is_new = self._keyboard.press(code, name, self._clock.now_ns())
        command = command_of(name, is_new, self._is_replay)
        if command is not None and stop is None:
            self._ask(command)
        if is_new:
            self._beat()
            self._arrange(name)
            if name == "F1":
                self._keys.set_visible(not self._keys.get_visible())
            elif name == "F2":
                self._corrected.toggle()
            elif name == "F11" and self.window.is_fullscreen():
                self.window.unfullscreen()
            elif name == "F11":
                self.window.fullscreen()
        return True

    def _arrange(self, name: str) -> None:
        """Pin or exchange views, if that is what the key is for; in no trial, and for no marks."""
        views = self._opening.views
        if self._opening.blind:
            return
        if name == "Tab":
            self._places.swap()
        elif name.isdecimal() and 0 < int(name) <= len(views):
            self._places.pin(views[int(name) - 1])
        else:
            return
        self._application.report(Pin(self._clock.now_ns(), self._places.pinned))
        self._show_textures(self._places.views)
        self._show_places()

    def _clicked(self, _button: Any) -> None:
        """The banner's button does what is written on it."""
        if self._shown is not None and self._shown.end is not None:
            self._ask(Command.QUIT)
        else:
            self._ask(Command.CONFIRM if self._is_replay else Command.EMERGENCY_STOP)

    def _released(self, _keys: Any, _value: int, code: int, _modifiers: Any) -> None:
        self._keyboard.release(code)
        self._beat()

    def _name(self, code: int, layout: int) -> str:
        """The key's, the same whatever modifiers are down."""
        Gdk = self._modules.Gdk
        known, places, values = Gdk.Display.get_default().map_keycode(code)
        symbols = (
            Symbol(
                place.group,
                place.level,
                Gdk.keyval_name(value) or "",
                Gdk.keyval_to_unicode(value),
            )
            for place, value in zip(places, values, strict=True)
        )
        return key_name(code, layout, symbols if known else ())

    def _look_at_modifiers(self) -> None:
        keyboard = self._seat.get_keyboard()
        shift = self._modules.Gdk.ModifierType.SHIFT_MASK
        has_shift = keyboard is not None and bool(keyboard.get_modifier_state() & shift)
        self._keyboard.modifiers(has_shift, self._clock.now_ns())

    def _closed(self, *_: Any) -> bool:
        """The operator closes it: the application ends the session, and this process with it."""
        self._ask(Command.CLOSE)
        return True

    def _ask(self, command: Command) -> None:
        self._application.report(CommandRequest(self._clock.now_ns(), command))

    def _seek(self, t_s: float) -> None:
        self._application.report(Seek(self._clock.now_ns(), t_s))
        self._figures_ns = 0  # what is sought is shown as soon as it is found

    def _beat(self, *_: Any) -> bool:
        self._look_at_modifiers()
        self._pixel.queue_draw()  # whether or not there is anything new: paints are a sign of life
        keyboard, sight = self._keyboard, self._sight
        has_keys = sight.look() and self.window.is_active()
        now_ns = self._clock.now_ns()
        if has_keys != keyboard.focused:
            keyboard.focus(has_keys, now_ns)
        if now_ns - self._looked_ns > _NOT_LOOKING_NS:
            return True  # old pictures stay: to the session that is no sign of life
        self._application.report(
            Keys(now_ns, has_keys, keyboard.held, self._drawings, keyboard.presses, sight.seen_ns)
        )
        return True

    def _draw_pixel(self, _area: Any, context: Any, *_: Any) -> None:
        """A shade that is not seen, and never the same twice: what has not changed is not sent."""
        self._shade ^= 1
        context.set_source_rgba(0.0, 0.0, 0.0, self._shade / 255)
        context.paint()

    # --- what is shown --------------------------------------------------------------------------

    def await_frames(self, stop: threading.Event) -> None:
        """Look at once when the large picture's view has a new frame; a worker's body."""
        for _ in self._arrivals.until(stop):
            self._modules.GLib.idle_add(self._look_once, priority=self._after_paints)

    def _realized(self, window: Any) -> None:
        self._sight = Sight(window, self._clock)
        window.get_frame_clock().connect("after-paint", self._painted)

    def _painted(self, _clock: Any) -> None:
        put_ns, self._put_ns = self._put_ns, 0
        now_ns = self._clock.now_ns()
        self._sight.painted(now_ns, dict(self._corrected.put_ns))
        self._display.step(DISPLAY, put_ns, now_ns)

    def _look_once(self) -> bool:
        return not self._look()

    def _look(self) -> bool:
        now_ns = self._clock.now_ns()
        if (facts := self._facts.newer(now_ns)) is not None:
            self._take_in(facts, now_ns)
        newest = self._corrected.version(self._places.large, now_ns)
        if self._pacer.may_draw(now_ns, newest) and self._take_frames():
            self._drawings += 1
            self._pacer.drawn(now_ns, time.process_time_ns())
        self._looked_ns = self._clock.now_ns()
        return True

    def _take_in(self, facts: FaceFacts, now_ns: int) -> None:
        self._shown = facts
        self._history.add(facts)
        with_display = self._with_display(facts)
        shown = shown_of(with_display, self._opening, self._keyboard.shift_is_dead)
        self._banner.show(shown.banner)
        classes = [state_class(facts.state.arming)]
        classes += [] if facts.silent_s is None else [SILENT_CLASS]
        if classes != self._classes:  # GTK styles the whole window anew
            self._classes = classes
            self._frame.set_css_classes(classes)
            self._figures_ns = 0
        if self._places.step(facts.state.primary_view, now_ns):
            self._show_textures(self._places.views)
        self._show_places()
        self._pictures[0].notice(shown.placed)
        self._end.show(facts.end)
        if now_ns - self._figures_ns >= _FIGURES_NS:
            self._figures_ns = now_ns
            self._adapt()
            self._panel.show(shown)
            self._timeline.show(shown)
            self._episodes.show(shown)
            self._notice.set_text(shown.notice)
            self._status.set_text(shown.status)

    def _with_display(self, facts: FaceFacts) -> FaceFacts:
        """The facts with the time that drawing takes in the primary view's latency."""
        views, primary = facts.state.views, facts.state.primary_view
        own = together(views[primary].own, self._display.latency) if primary in views else None
        if own is None:
            return facts
        views = {**views, primary: replace(views[primary], own=own)}
        return replace(facts, state=replace(facts.state, views=views))

    def _show_places(self) -> None:
        self._arrivals.view = self._places.large
        state = None if self._shown is None else self._shown.state
        for view, picture in zip(self._places.views, self._pictures, strict=True):
            title = view_title(view, state, self._opening, view == self._places.pinned)
            title += self._corrected.words(view)
            picture.set_title(title, view_class(self._opening.views.index(view)))

    def _take_frames(self) -> bool:
        """Show the newest frame of each view, or how it looks by now; whether any has changed."""
        large, put_ns = self._places.large, self._corrected.put_ns
        before_ns = put_ns.get(large)
        changed = {view: texture_of(image) for view, image in self._corrected.changed()}
        if put_ns.get(large) != before_ns:
            self._put_ns = put_ns[large]
        self._textures.update(changed)
        self._show_textures(changed)
        return bool(changed)

    def _show_textures(self, views: Any) -> None:
        for view, picture in zip(self._places.views, self._pictures, strict=True):
            if view in views:
                picture.show(self._textures.get(view))

"""The headset's display, step by step: facts and frames in, changed parts of the atlas out."""

from __future__ import annotations

import time

from hw.openvr.overlays import Overlays
from tams_app import palette
from tams_app.config import HeadsetConfig
from tams_app.faces.application import Opened
from tams_app.faces.headset.layout import Atlas, Crop, panel_place, view_places
from tams_app.faces.headset.painting import ViewCell, paint_panel
from tams_app.faces.headset.texture import AtlasTexture
from tams_app.faces.messages import FaceFacts
from tams_app.faces.shown import PanelWords, is_old, shown_of, view_title
from tams_app.faces.views import Corrected, DrawPacer, Places
from tams_app.runtime.clock import Clock

PANEL = "panel"


def overlay_names(views: tuple[str, ...]) -> tuple[str, ...]:
    """One for each place of a view, the one in front first, and the panel's."""
    return *(f"view {number}" for number, _ in enumerate(views)), PANEL


class HeadsetDisplay:
    """Draws what has changed, and no more often than frames come.

    An overlay is a place, not a view: where views exchange their places, only the part of the
    atlas that each overlay shows is another one. Nothing moves, nothing is hidden, so nothing
    flickers.
    """

    def __init__(
        self,
        opened: Opened,
        config: HeadsetConfig,
        overlays: Overlays,
        texture: AtlasTexture,
        clock: Clock,
    ) -> None:
        """`overlays`: of `overlay_names`. SetupError if there is no texture for all of it."""
        self._opening, self._facts = opened.opening, opened.facts
        self._overlays, self._texture = overlays, texture
        views = self._opening.views
        self._atlas = Atlas(views, self._opening.width, self._opening.height)
        texture.create(self._atlas.width, self._atlas.height)
        self._cells = {
            view: ViewCell(self._atlas, palette.view_colour(number))
            for number, view in enumerate(views)
        }
        self._corrected = Corrected(opened.present, opened.frames, clock)
        self._places = Places(views)
        self._words: PanelWords | None = None
        self._dirty = set(views)
        self._pacer = DrawPacer(clock.now_ns(), time.process_time_ns())
        self.drawings = 0
        self.seen_ns: dict[str, int] = {}  # of those that SteamVR has
        for view in views:
            self._cells[view].set_title(view_title(view, None, self._opening), False)
        self._arrange(config)

    def step(self, now_ns: int) -> None:
        """Take in what is new, and show it if it is time to."""
        if (facts := self._facts.newer(now_ns)) is not None:
            self._take_in(facts, now_ns)
        if self._pacer.may_draw(now_ns, self._corrected.version(self._places.large, now_ns)):
            for view, image in self._corrected.changed():
                self._cells[view].show(image)
                self._dirty.add(view)
            if self._dirty:
                self._draw()  # raises what SteamVR refuses
                self._pacer.drawn(now_ns, time.process_time_ns())
                self.seen_ns = dict(self._corrected.put_ns)

    def _arrange(self, config: HeadsetConfig) -> None:
        places = [*view_places(config, len(self._cells)), panel_place(config, self._atlas)]
        for number, place in enumerate(places):
            self._overlays.arrange(number, place.pose, place.width_m)
        for number, view in enumerate(self._places.views):
            self._crop(number, self._atlas.cells[view])
        self._crop(len(self._cells), self._atlas.panel)

    def _crop(self, number: int, part: Crop) -> None:
        width, height = self._atlas.width, self._atlas.height
        self._overlays.crop(
            number,
            part.left / width,
            part.top / height,
            (part.left + part.width) / width,
            (part.top + part.height) / height,
        )

    def _take_in(self, facts: FaceFacts, now_ns: int) -> None:
        opening = self._opening
        for view, cell in self._cells.items():
            title = view_title(view, facts.state, opening) + self._corrected.words(view)
            silent = facts.silent_s is not None
            old = is_old(facts.state.views.get(view), opening.old_ms)
            if cell.set_title(title, silent or old, silent):
                self._dirty.add(view)
        words = shown_of(facts, opening).panel
        if words != self._words:
            self._words = words
            self._texture.put(
                self._atlas.panel.left, self._atlas.panel.top, paint_panel(self._atlas.panel, words)
            )
            self._dirty.add(PANEL)
        before = self._places.views
        if self._places.step(facts.state.primary_view, now_ns):
            self._exchange(before)

    def _exchange(self, before: tuple[str, ...]) -> None:
        for number, view in enumerate(self._places.views):
            if view != before[number]:
                # its copy of the atlas has what this view was when the overlay was submitted last
                self._overlays.submit(number, self._texture.handle)
                self._crop(number, self._atlas.cells[view])
        self._texture.flush()

    def _draw(self) -> None:
        for view in self._dirty - {PANEL}:
            cell = self._atlas.cells[view]
            self._texture.put(cell.left, cell.top, self._cells[view].pixels)
        for number, shown in enumerate((*self._places.views, PANEL)):
            if shown in self._dirty:
                self._overlays.submit(number, self._texture.handle)
        self._texture.flush()
        self._dirty.clear()
        self.drawings += 1

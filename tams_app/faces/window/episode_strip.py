"""The strip of a session's episodes: the running one, what is asked, and the last ones."""

from __future__ import annotations

from tams_app.faces import episodes
from tams_app.faces.messages import Facts
from tams_app.faces.window.toolkit import load


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

    def show(self, facts: Facts) -> None:
        """The episodes as they stand."""
        state = facts.state.episodes
        self.widget.set_visible(state is not None)
        if state is None:
            return
        texts = episodes.strip_texts(state, facts.replay is not None, facts.end is not None)
        for label, text in zip(self._labels, texts, strict=True):
            label.set_text(text)
            label.set_visible(bool(text) or label.get_hexpand())

"""The newest frame of each view as it is drawn: as received, or with what is known of now."""

from __future__ import annotations

from collections.abc import Mapping

from tams_app.prediction.present import AsReceived, Correction
from tams_app.records import Image
from tams_app.runtime.clock import Clock
from tams_app.station.mount_memory import PresentViews
from tams_app.video.live.frame_ring import FrameReader


class Corrected:
    """`newest` tells the frame to draw, `words` what the view's title says of it."""

    def __init__(
        self, present: PresentViews | None, frames: Mapping[str, FrameReader], clock: Clock
    ) -> None:
        """`present`: the views that are corrected; None: none is."""
        self._present, self._frames, self._clock = present, frames, clock
        self._is_on = True
        self._taken = dict.fromkeys(frames, 0)  # how many were written when the newest was taken
        self.put_ns: dict[str, int] = {}  # by view, when the frame was put that was taken last
        self._drawn: dict[str, tuple[Correction | None, AsReceived | None]] = {}

    def toggle(self) -> None:
        """Show all frames as received from now on, or correct them again."""
        self._is_on = not self._is_on
        self._taken = dict.fromkeys(self._taken, 0)  # what is drawn changes at once

    def is_new(self, view: str) -> bool:
        """Whether there is a frame that was not taken yet, or one that looks different by now."""
        return self.has_come(view) or self.moves(view)

    def has_come(self, view: str) -> bool:
        """Whether there is a frame that was not taken yet."""
        return self._frames[view].written() != self._taken[view]

    def moves(self, view: str) -> bool:
        """Whether a frame that was drawn looks different later on."""
        return self._is_on and view in self._drawn and self._drawn[view][1] is None

    def version(self, view: str, now_ns: int) -> tuple[str, int]:
        """What the frame to draw is known by; one that moves is another one at each look."""
        return view, now_ns if self.moves(view) else self._frames[view].written()

    def newest(self, view: str) -> Image | None:
        """The frame to draw now; None before the first, or if it was overwritten meanwhile."""
        reader = self._frames[view]
        written, put_ns = reader.written(), reader.newest_put_ns()
        found = reader.newest_frame()
        if found is None:
            return None
        self._taken[view], self.put_ns[view] = written, put_ns
        capture_ns, image = found
        if self._present is None or view not in self._present or not self._is_on:
            return image
        shown = self._present.show(view, image, capture_ns, self._clock.now_ns())
        self._drawn[view] = shown.correction, shown.as_received
        return shown.image

    def words(self, view: str) -> str:
        """What the title says besides; "" where there is nothing to correct."""
        if self._present is None or view not in self._present:
            return ""
        if not self._is_on:
            return " · as received"
        correction, why = self._drawn.get(view, (None, None))
        if why is not None:
            return f" · as received: {why}"
        return "" if correction is None else f" · {correction}"

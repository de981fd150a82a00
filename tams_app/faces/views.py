"""The views as a face draws them: which has the large place, which frame, and how often."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tams_app.prediction.present import AsReceived, Correction
from tams_app.records import Image
from tams_app.runtime.clock import Clock
from tams_app.station.mount_memory import PresentViews
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.frame_ring import FrameReader

STAYS_NS = 800 * NS_PER_MS
SHARE = 0.25  # of a core: a graphics processor needs less for 30 frames a second of three views
LEAST_NS = 22 * NS_PER_MS  # the views' frames come one after the other: some go together
MOST_NS = 250 * NS_PER_MS
EARLY_NS = 16 * NS_PER_MS  # a frame that comes so long before its time is not put off
FOLLOWS_NS = 50 * NS_PER_MS  # for so long all others wait for the large picture's next frame
_JUDGED_NS = NS_PER_S // 2


class Places:
    """The first place is the large one. The primary view takes it; the two exchange their places.

    What has just been exchanged stays for a moment, so that a short phase does not throw the views
    to and fro. A view that is pinned has the first place, whichever is the primary one.
    """

    def __init__(self, views: tuple[str, ...]) -> None:
        self.views = views
        self.pinned = ""
        self._changed_ns: int | None = None

    @property
    def large(self) -> str:
        """The view in the first place."""
        return self.views[0]

    def step(self, primary: str, now_ns: int) -> bool:
        """Assign anew; True if the places have changed. `views` has them in order."""
        if self.pinned:
            return False
        if primary not in self.views or primary == self.views[0]:
            return False
        if self._changed_ns is not None and now_ns - self._changed_ns < STAYS_NS:
            return False
        self._put_first(primary)
        self._changed_ns = now_ns
        return True

    def pin(self, view: str) -> None:
        """Keep `view` in the first place; the one that is there already is let go."""
        self.pinned = "" if view == self.pinned else view
        self._changed_ns = None
        if self.pinned:
            self._put_first(view)

    def swap(self) -> None:
        """Pin the view that comes after the large one."""
        self.pin(self.views[1 % len(self.views)])

    def _put_first(self, view: str) -> None:
        first = self.views[0]
        swapped = {view: first, first: view}
        self.views = tuple(swapped.get(one, one) for one in self.views)


class Corrected:
    """The newest frame of each view as it is drawn: as received, or with what is known of now.

    `newest` has the frame to draw, `words` what the view's title says of it.
    """

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

    def changed(self) -> Iterator[tuple[str, Image]]:
        """The views with a frame that was not taken yet, or that looks different by now, and it.

        One that was overwritten meanwhile is left out: the next look finds a newer one.
        """
        for view, reader in self._frames.items():
            is_new = reader.written() != self._taken[view] or self.moves(view)
            if is_new and (image := self.newest(view)) is not None:
                yield view, image

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


class DrawPacer:
    """Decides when to draw: at the pace of the frames, within a share of one core.

    What is drawn then is always the newest, so a slow one is never late.

    Frames of the large picture are drawn as they come, and the other views' with them, or they are
    left to the next one: drawn between two they would be older, and put off the second. So the
    intervals are not even, only their mean is kept.

    The cost of a drawing is what the whole process used of the processor since the last judgement,
    by the drawings since: software rendering works in threads of its own, after the drawing.
    """

    def __init__(self, now_ns: int, used_ns: int) -> None:
        """`used_ns`: processor time of the process so far, all its threads."""
        self.interval_ns = LEAST_NS
        self._due_ns = 0
        self._newest: object = None
        self._drawings = 0
        self._judged_ns, self._used_ns = now_ns, used_ns

    def may_draw(self, now_ns: int, newest: object) -> bool:
        """True if it is time to draw again, if there is something new; ask often.

        `newest`: what the newest frame of the large picture is known by.
        """
        has_come, self._newest = newest != self._newest, newest
        return now_ns - self._due_ns >= (-EARLY_NS if has_come else FOLLOWS_NS)

    def drawn(self, now_ns: int, used_ns: int) -> None:
        """A drawing was made; `used_ns` as above."""
        self._due_ns = max(self._due_ns, now_ns - EARLY_NS) + self.interval_ns
        self._drawings += 1
        if now_ns - self._judged_ns >= _JUDGED_NS:
            cost_ns = (used_ns - self._used_ns) / self._drawings
            self.interval_ns = min(max(LEAST_NS, round(cost_ns / SHARE)), MOST_NS)
            self._judged_ns, self._used_ns, self._drawings = now_ns, used_ns, 0

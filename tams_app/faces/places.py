"""The assignment of views to places in the window; pure."""

from __future__ import annotations

from tams_app.units import NS_PER_MS

STAYS_NS = 800 * NS_PER_MS


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

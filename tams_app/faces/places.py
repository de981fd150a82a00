"""The assignment of views to places in the window; pure."""

from __future__ import annotations

from tams_app.units import NS_PER_MS

STAYS_NS = 800 * NS_PER_MS


class Places:
    """The first place is the large one. The primary view takes it; the two exchange their places.

    What has just been exchanged stays for a moment, so that a short phase does not throw the views
    to and fro.
    """

    def __init__(self, views: tuple[str, ...]) -> None:
        self.views = views
        self._changed_ns: int | None = None

    def step(self, primary: str, now_ns: int) -> bool:
        """Assign anew; True if the places have changed. `views` has them in order."""
        if primary not in self.views or primary == self.views[0]:
            return False
        if self._changed_ns is not None and now_ns - self._changed_ns < STAYS_NS:
            return False
        swapped = {primary: self.views[0], self.views[0]: primary}
        self.views = tuple(swapped.get(view, view) for view in self.views)
        self._changed_ns = now_ns
        return True

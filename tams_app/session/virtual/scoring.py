"""Every frame scored: nothing is left out where time waits."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from tams_app.records import Frame, FrameQuality, ShownFrame
from tams_app.video.quality import Fate, Scorer, ViewQuality
from tams_app.video.ssim import luma_of


class FrameScores:
    """The accounts of `views`; each captured frame's record comes once its fate is decided.

    Frames of other views pass unseen.
    """

    def __init__(self, views: Iterable[str], record: Callable[[FrameQuality], None]) -> None:
        self._views = {view: (ViewQuality(view), Scorer()) for view in views}
        self._record = record

    def captured(self, frame: Frame) -> None:
        """A camera's frame, in the order of capture."""
        if frame.view in self._views:
            accounts, _ = self._views[frame.view]
            fates = accounts.captured(frame.index, frame.capture_ns, luma_of(frame.image))
            self._score(frame.view, fates)

    def shown(self, shown: ShownFrame) -> None:
        """A frame that reached the screen, after the captures that came before it."""
        if shown.view in self._views:
            accounts, _ = self._views[shown.view]
            fates = accounts.shown(shown.index, shown.shown_ns, luma_of(shown.image))
            self._score(shown.view, fates)

    def finish(self, end_ns: int) -> None:
        """Nothing more comes."""
        for view, (accounts, _) in self._views.items():
            self._score(view, accounts.finish(end_ns))

    def _score(self, view: str, fates: list[Fate]) -> None:
        scorer = self._views[view][1]
        for fate in fates:
            self._record(scorer.score(fate))

"""The helper process that compares shown frames with captured ones, with the time left over.

Specification: captured_memory, shown_memory, mount_memory ("": none), views, width, height,
cameras (`PredictedCamera` by view), reports. It reports every captured frame's fate as a
FrameQuality, with scores where there was time to spare (`SparePace`), each view in turn, so that
what is left out is spread evenly.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import cv2
import psutil

from tams_app.prediction.present import Shown
from tams_app.records import FrameQuality, Image
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import keep_freed_memory, use_idle
from tams_app.runtime.shared_ring import open_block
from tams_app.station.mount_memory import described_views
from tams_app.units import NS_PER_MS
from tams_app.video.core.quality import Correction, Fate, Scorer, ViewQuality
from tams_app.video.live.frame_ring import CAPTURED, SHOWN, FrameReader, RingLayout
from tams_app.video.live.reporting_helper import line_of, reports_to_session

WAITING_FATES = 15  # per view: half a second; older ones go out without scores
_POLL_S = 0.05  # the rings hold half a second of images
_FINISH_NS = 700 * NS_PER_MS  # for what is left at the end
_SEND_TIMEOUT_S = 30.0

LEAST_SHARE = 0.04  # of one core: a few frames a second, so that there is always a figure
LARGEST_SHARE = 0.5
SCARCE_IDLE, AMPLE_IDLE = 0.05, 0.10  # of all cores
_LOOK_NS = 500 * NS_PER_MS
_GROWTH, _BACK_OFF = 0.05, 0.5


class SparePace:
    """The share of a core that may be used: halved while no core is idle, else grown slowly.

    `idle_fraction`: how much of all cores was idle since its last call (0 to 1).
    """

    def __init__(self, idle_fraction: Callable[[], float], now_ns: int) -> None:
        self.share = LEAST_SHARE
        self._idle_fraction = idle_fraction
        self._looked_ns = now_ns

    def rest_ns(self, worked_ns: int, now_ns: int) -> int:
        """The rest [ns] after `worked_ns` of work that ends now."""
        if now_ns - self._looked_ns >= _LOOK_NS:
            self._looked_ns = now_ns
            self._adapt(self._idle_fraction())
        return round(worked_ns * (1 / self.share - 1))

    def _adapt(self, idle: float) -> None:
        if idle < SCARCE_IDLE:
            self.share = max(LEAST_SHARE, self.share * _BACK_OFF)
        elif idle > AMPLE_IDLE:
            self.share = min(LARGEST_SHARE, self.share + _GROWTH)


class ViewScores:
    """One view: reads its rings, keeps its accounts, scores what it has time for."""

    def __init__(
        self,
        view: str,
        captured: FrameReader,
        shown: FrameReader,
        report: Callable[[FrameQuality], None],
        correct: Correction | None = None,
    ) -> None:
        """`correct`: as for `ViewQuality`."""
        self._captured = captured
        self._shown = shown
        self._report = report
        self._quality = ViewQuality(view, correct=correct)
        self._scorer = Scorer()
        self._waiting: deque[Fate] = deque()

    def take_in(self) -> None:
        """Read what is new; the oldest waiting fates leave without scores if there are too many."""
        shown_until = self._shown.written()  # first: then their captures are in the other ring
        captures = self._captured.read(self._captured.written())
        events = [(one.t_ns, CAPTURED, one) for one in captures]
        events += [(one.t_ns, SHOWN, one) for one in self._shown.read(shown_until)]
        for t_ns, kind, one in sorted(events, key=lambda event: event[0]):
            self._waiting.extend(
                self._quality.captured(one.index, t_ns, one.luma, one.task)
                if kind == CAPTURED
                else self._quality.shown(one.index, t_ns, one.luma)
            )
        self.leave_out(WAITING_FATES)

    def score_next(self) -> bool:
        """Score the fate that has waited longest; False if there is none."""
        if not self._waiting:
            return False
        self._report(self._scorer.score(self._waiting.popleft()))
        return True

    def finish(self, end_ns: int) -> None:
        """Take in the last frames and decide the rest."""
        self.take_in()
        self._waiting.extend(self._quality.finish(end_ns))

    def leave_out(self, room: int = 0) -> None:
        """Report what still waits without scores, the oldest first, until `room` are left."""
        while len(self._waiting) > room:
            self._report(self._waiting.popleft().record)


def run(views: list[ViewScores], clock: Clock, pace: SparePace, stop: threading.Event) -> None:
    """Score until `stop` is set, then what is left for a moment."""
    resting_until_ns = 0
    while not stop.is_set():
        for view in views:
            view.take_in()
        began_ns = clock.now_ns()
        if began_ns >= resting_until_ns and _score_one_each(views):
            ended_ns = clock.now_ns()
            resting_until_ns = ended_ns + pace.rest_ns(ended_ns - began_ns, ended_ns)
        else:
            stop.wait(_POLL_S)
    end_ns = clock.now_ns()
    for view in views:
        view.finish(end_ns)
    while clock.now_ns() < end_ns + _FINISH_NS and _score_one_each(views):
        pass
    for view in views:
        view.leave_out()


def _score_one_each(views: list[ViewScores]) -> bool:
    scored = [view.score_next() for view in views]
    return any(scored)


def idle_fraction() -> float:
    """The share of all cores that was idle since the last call."""
    return 1 - psutil.cpu_percent() / 100


def main() -> None:
    side = HelperSide()
    use_idle()
    keep_freed_memory()
    cv2.setNumThreads(1)
    specification: dict[str, Any] = side.specification
    names = tuple(specification["views"])
    size = int(specification["width"]), int(specification["height"])
    captured, shown = RingLayout(CAPTURED, names, *size), RingLayout(SHOWN, names, *size)
    with (
        open_block(str(specification["captured_memory"])) as captures,
        open_block(str(specification["shown_memory"])) as screen,
        reports_to_session(specification, _SEND_TIMEOUT_S) as results,
    ):

        def report(quality: FrameQuality) -> None:
            results.sendall(line_of(quality))

        shows = described_views(specification)
        views = [
            ViewScores(
                name,
                FrameReader(captures, captured, name),
                FrameReader(screen, shown, name),
                report,
                _luma(shows[name]) if name in shows else None,
            )
            for name in names
        ]
        side.ready()
        try:
            clock = MonotonicClock()
            run(views, clock, SparePace(idle_fraction, clock.now_ns()), side.stop_requested)
        except ConnectionError as error:
            raise SystemExit("the session is gone") from error


def _luma(show: Callable[[Image, int, int], Shown]) -> Correction:
    """The luma of what the operator is shown of a frame that is corrected."""
    return lambda luma, capture_ns, now_ns: show(luma, capture_ns, now_ns).image


if __name__ == "__main__":
    main()

"""The fate of each captured frame of one view, and the images that its quality is measured by.

Pure accounting: captures and shown frames go in, each in its own order; a captured frame comes out
once its fate is decided, with the images to compare. `Scorer` compares them (see ssim).
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from tams_app.records import FrameQuality, TaskRegion
from tams_app.video.core.rate_control import FrameIntervals, freeze_ns
from tams_app.video.core.ssim import FrameMoments, Luma, Similarity, similarity

Correction: TypeAlias = Callable[[Luma, int, int], Luma]
"""What the screen shows of a frame (captured [ns]) at a time [ns], where it is corrected."""

WINDOW_FRAMES = 90  # three seconds: the link, repair and decoding keep nothing for as long
_KEPT_MOMENTS = 8  # images; one takes 2.5 MB


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """One image; `luma` is None where it is no longer there. Equal only to itself."""

    luma: Luma | None


@dataclass(frozen=True, slots=True)
class Fate:
    """A captured frame whose fate is decided: its record without scores, and what to score.

    `shown`: its own image as shown, `stand_in`: what was shown in its place (its own, or that of
    the greatest smaller index), `on_screen`: what was shown at its capture. None: there is none.
    `task`: where the task is in what was captured; None: not known.
    """

    record: FrameQuality
    captured: Image
    shown: Image | None
    stand_in: Image | None
    on_screen: Image | None
    task: TaskRegion | None


@dataclass(frozen=True, slots=True)
class _Captured:
    capture_ns: int
    image: Image
    task: TaskRegion | None


@dataclass(frozen=True, slots=True)
class _Shown:
    index: int
    shown_ns: int
    image: Image
    capture_ns: int | None  # None: shown without having been captured


class ViewQuality:
    """The fate of the frames of one view, over the last `window_frames` captures.

    A frame's fate is decided when it or a later one is shown; or when the window moves past it:
    shown later still, it stays "never shown". Give a shown frame after the captures that came
    before it.
    """

    def __init__(
        self, view: str, window_frames: int = WINDOW_FRAMES, correct: Correction | None = None
    ) -> None:
        """`correct`: what is on screen of a frame; None: the frame."""
        self._view = view
        self._window_frames = window_frames
        self._correct = correct
        self._pending: OrderedDict[int, _Captured] = OrderedDict()
        self._history: deque[_Shown] = deque()  # from what pending captures found on screen on
        self._newest_capture_ns = 0
        self._intervals = FrameIntervals(0)
        self._freeze_ns = 0

    def captured(
        self, index: int, capture_ns: int, luma: Luma | None, task: TaskRegion | None = None
    ) -> list[Fate]:
        """A camera's frame; decides the oldest one if the window is full.

        `task`: where the task is in it; None: not known.
        """
        self._pending[index] = _Captured(capture_ns, Image(luma), task)
        self._newest_capture_ns = capture_ns
        self._freeze_ns = freeze_ns(self._intervals.step(capture_ns).usual_ns)
        if len(self._pending) <= self._window_frames:
            return []
        oldest, capture = self._pending.popitem(last=False)
        return [self._decide(oldest, capture, None, capture_ns)]

    def shown(self, index: int, shown_ns: int, luma: Luma | None) -> list[Fate]:
        """An image that reached the screen; decides all captures up to it."""
        own = self._pending.get(index)
        capture_ns = own.capture_ns if own else None
        shown = _Shown(index, shown_ns, Image(luma), capture_ns)
        self._history.append(shown)
        due = [number for number in self._pending if number <= index]
        fates = [
            self._decide(
                number, self._pending.pop(number), shown if number == index else None, shown_ns
            )
            for number in due
        ]
        self._forget()
        return fates

    def finish(self, end_ns: int) -> list[Fate]:
        """Nothing more comes: decide what is left."""
        left, self._pending = self._pending, OrderedDict()
        return [self._decide(number, capture, None, end_ns) for number, capture in left.items()]

    def _decide(self, index: int, capture: _Captured, shown: _Shown | None, now_ns: int) -> Fate:
        before = [one for one in self._history if one.shown_ns <= capture.capture_ns]
        on_screen = before[-1] if before else None
        seen_ns = on_screen.capture_ns if on_screen else None
        stand_in = shown or max(
            (one for one in self._history if one.index < index),
            key=lambda one: one.index,
            default=None,
        )
        record = FrameQuality(
            view=self._view,
            index=index,
            capture_ns=capture.capture_ns,
            shown_ns=shown.shown_ns if shown else None,
            age_ns=None if seen_ns is None else capture.capture_ns - seen_ns,
            frozen=on_screen is not None and self._stayed_ns(on_screen, now_ns) > self._freeze_ns,
            concealed=None,  # known from the log alone (`concealment`)
            received=None,
            delivered=None,
            live=None,
        )
        return Fate(
            record,
            capture.image,
            shown.image if shown else None,
            stand_in.image if stand_in else None,
            self._on_screen(on_screen, capture.capture_ns),
            capture.task,
        )

    def _on_screen(self, shown: _Shown | None, now_ns: int) -> Image | None:
        if shown is None or self._correct is None:
            return shown.image if shown else None
        if shown.image.luma is None or shown.capture_ns is None:
            return shown.image
        return Image(self._correct(shown.image.luma, shown.capture_ns, now_ns))

    def _stayed_ns(self, on_screen: _Shown, now_ns: int) -> int:
        """The time that an image stayed on screen, up to now."""
        ends = [one.shown_ns for one in self._history if one.shown_ns > on_screen.shown_ns]
        return min(ends, default=now_ns) - on_screen.shown_ns

    def _forget(self) -> None:
        """Drop what was on screen before any capture that is pending or still to come."""
        oldest = next(iter(self._pending.values()), None)
        since_ns = oldest.capture_ns if oldest else self._newest_capture_ns
        while len(self._history) > 1 and (
            self._history[1].shown_ns <= since_ns or len(self._history) > self._window_frames
        ):
            self._history.popleft()


class Scorer:
    """Compares the images of fates, each pair once; remembers the moments of what was shown.

    Give it one view's fates in order: what is shown is on screen a few captures later.
    """

    def __init__(self) -> None:
        self._moments: OrderedDict[Image, FrameMoments] = OrderedDict()

    def score(self, fate: Fate) -> FrameQuality:
        """The frame's record with its scores, each twice: of all of it, and of the task's region.

        None where an image is missing, or the region.
        """
        if fate.captured.luma is None:
            return fate.record
        captured = FrameMoments.of(fate.captured.luma)
        images = {fate.shown, fate.stand_in, fate.on_screen}  # two of them may be one
        scores = {image: self._compare(captured, image, fate.task) for image in images}
        received, delivered, live = (
            scores[image] for image in (fate.shown, fate.stand_in, fate.on_screen)
        )
        return replace(
            fate.record,
            received=received.whole if received else None,
            delivered=delivered.whole if delivered else None,
            live=live.whole if live else None,
            task_received=received.task if received else None,
            task_delivered=delivered.task if delivered else None,
            task_live=live.task if live else None,
        )

    def _compare(
        self, captured: FrameMoments, shown: Image | None, task: TaskRegion | None
    ) -> Similarity | None:
        if shown is None or shown.luma is None:
            return None
        moments = self._moments.get(shown)
        if moments is None:
            moments = self._moments[shown] = FrameMoments.of(shown.luma)
        self._moments.move_to_end(shown)
        if len(self._moments) > _KEPT_MOMENTS:
            self._moments.popitem(last=False)
        return similarity(captured, moments, task)

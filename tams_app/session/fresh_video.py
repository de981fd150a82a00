"""Which frame of each view the operator can steer by: the age of the video counts from it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

from tams_app.records import ShownFrame
from tams_app.session.faces import Faces

_WAITING = 64  # frames decoded since the last sign of life of a face: a second or two


@dataclass(frozen=True, slots=True)
class SteeredBy:
    """The newest frame of one view that counts; both None before the first.

    `is_damaged`: the operator sees a newer one, which does not count because it is not whole.
    """

    index: int | None = None
    capture_ns: int | None = None
    is_damaged: bool = False


@dataclass(frozen=True, slots=True)
class _Decoded:
    shown_ns: int
    index: int
    capture_ns: int
    whole: bool


class FreshVideo:
    """The frames shown of all views, of which one counts on two conditions; from any thread.

    It is whole (`tams_app.video.core.whole_chain`), and each face that shows it has given a sign of
    life since it was decoded: a face that stands still shows what it showed before. Without faces
    a frame counts at once.
    """

    def __init__(self, views: Iterable[str], faces: Faces) -> None:
        self._faces = faces
        self._lock = threading.Lock()
        self._steered_by = dict.fromkeys(views, SteeredBy())
        self._waiting: dict[str, deque[_Decoded]] = {
            view: deque(maxlen=_WAITING) for view in self._steered_by
        }

    def shown(self, frame: ShownFrame) -> None:
        """A frame was decoded; each view's in order."""
        decoded = _Decoded(frame.shown_ns, frame.index, frame.capture_ns, frame.whole)
        with self._lock:
            self._waiting[frame.view].append(decoded)

    def of(self, view: str) -> SteeredBy:
        """What the operator can steer by in this view now."""
        seen_ns = self._faces.heard_ns()
        with self._lock:
            now, waiting = self._steered_by[view], self._waiting[view]
            while waiting and (seen_ns is None or waiting[0].shown_ns <= seen_ns):
                one = waiting.popleft()
                if one.whole:
                    now = SteeredBy(one.index, one.capture_ns)
                else:
                    now = replace(now, is_damaged=True)
            self._steered_by[view] = now
            return now

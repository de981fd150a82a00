"""The frame of each view that the operator can steer by: the video's age counts from it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from tams_app.records import ShownFrame, SteeredBy

_WAITING = 64  # frames decoded since the one that a display shows: a second or two


@dataclass(frozen=True, slots=True)
class _Decoded:
    shown_ns: int
    index: int
    capture_ns: int
    whole: bool


class Displays:
    """Window and headset of a session, on which old pictures stay once one is dead; any thread."""

    def __init__(self) -> None:
        self._seen_ns: tuple[Callable[[str], int], ...] = ()

    def add(self, seen_ns: Callable[[str], int]) -> None:
        """Add one; `seen_ns`: when the frame of a view that it shows was decoded, or it opened."""
        self._seen_ns = (*self._seen_ns, seen_ns)

    def __bool__(self) -> bool:
        return bool(self._seen_ns)

    def seen_ns(self, view: str) -> int | None:
        """When the newest frame of `view` that all show was decoded [ns]; None without any."""
        return min((seen_ns(view) for seen_ns in self._seen_ns), default=None)


class FreshVideo:
    """The decoded frames of all views, and which of each counts; from any thread.

    It is whole (`tams_app.video.core.receiver`), and each display shows it, or a newer one: one
    that stands still, or puts off its drawing, shows what it showed before. Without displays a
    frame counts at once.
    """

    def __init__(self, views: Iterable[str], displays: Displays) -> None:
        self._displays = displays
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
        """The frame of this view that the operator can steer by now."""
        seen_ns = self._displays.seen_ns(view)
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

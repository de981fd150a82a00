"""The cameras' frame rate: how many frames came, how many were missed and how many were damaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from operator import sub

from tams_app.records import CameraRates, Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S

PERIOD_NS = NS_PER_S


@dataclass(slots=True)
class _Count:
    """One view's frames since its first; written by its capture thread alone."""

    taken: int = 0
    overrun: int = 0  # the camera had them, the session did not take them
    damaged: int = 0  # they arrived so, and were left out


class FrameRates:
    """Counts frames, and records them once a second.

    What `through` gives runs in the capture threads, `poll` in one other.
    """

    def __init__(
        self, views: Sequence[str], clock: Clock, record: Callable[[CameraRates], None]
    ) -> None:
        self._clock = clock
        self._record = record
        self._counts = {view: _Count() for view in views}
        self._last_index: dict[str, int] = {}
        self._free_ns = dict.fromkeys(views, 0)  # when a thread began to wait for its next frame
        self._before: tuple[int, dict[str, _Count]] | None = None
        self.given_fps: Mapping[str, float] = {}  # by view, in the last period

    def through(self, push: Callable[[Frame], None]) -> Callable[[Frame], None]:
        """`push`, with the frames counted that pass."""

        def take(frame: Frame) -> None:
            view, count = frame.view, self._counts[frame.view]
            count.damaged += frame.damaged
            if view in self._last_index:
                count.taken += 1
                if frame.capture_ns < self._free_ns[view]:  # it was there before it was waited for
                    count.overrun += frame.index - self._last_index[view] - 1
            self._last_index[view] = frame.index
            push(frame)
            self._free_ns[view] = self._clock.now_ns()

        return take

    def poll(self) -> None:
        """Record what came since the last period, once that is over."""
        now_ns = self._clock.now_ns()
        if self._before is not None and now_ns - self._before[0] < PERIOD_NS:
            return
        counts = {view: _Count(*astuple(count)) for view, count in self._counts.items()}
        if self._before is None:
            if any(not count.taken for count in counts.values()):
                return
            self._record(CameraRates(now_ns, {}, {}))
        else:
            before_ns, before = self._before
            passed_s = (now_ns - before_ns) / NS_PER_S
            since = {
                view: _Count(*map(sub, astuple(count), astuple(before[view])))
                for view, count in counts.items()
            }
            self.given_fps = {view: count.taken / passed_s for view, count in since.items()}
            overrun_fps = {view: count.overrun / passed_s for view, count in since.items()}
            damaged = {view: count.damaged for view, count in since.items()}
            self._record(CameraRates(now_ns, dict(self.given_fps), overrun_fps, damaged))
        self._before = now_ns, counts

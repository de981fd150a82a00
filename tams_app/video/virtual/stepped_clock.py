"""GStreamer's test clock: time moves on request, and its waits end one at a time."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from tams_app import gst
from tams_app.errors import SetupError, TamsError


class SteppedClock:
    """The clock of all pipelines of one run; also a `Clock` for the parts beside them.

    `start_ns` must not be 0: GStreamer takes a base time of 0 for none.
    """

    def __init__(self, start_ns: int) -> None:
        if start_ns <= 0:
            raise ValueError("virtual time must start after 0")
        self._clock = _test_clock_class().new_with_start_time(start_ns)
        self._never = gst.load().Gst.CLOCK_TIME_NONE
        self._now_ns = start_ns
        self.start_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.move_to(max(self._now_ns, deadline_ns))

    def suspended_ns(self) -> int:
        return 0

    def move_to(self, now_ns: int) -> None:
        """Set the time, which never goes back (ValueError); no wait ends by that alone."""
        if now_ns < self._now_ns:
            raise ValueError("virtual time does not go back")
        if now_ns > self._now_ns:
            self._now_ns = now_ns
            self._clock.set_time(now_ns)

    def next_ns(self) -> int | None:
        """The end of the next wait of any pipeline [ns]; None if there is none."""
        next_ns: int = self._clock.get_next_entry_time()
        return None if next_ns == self._never else next_ns

    def end_next_wait(self) -> None:
        """End the next wait, which is due."""
        wait = self._clock.process_next_clock_id()
        if wait is not None:
            _unreference(wait)

    def drive(self, pipeline: Any) -> None:
        """Let `pipeline`, not yet playing, run on this clock with running time 0 at the start."""
        pipeline.use_clock(self._clock)
        pipeline.set_start_time(self._never)
        pipeline.set_base_time(self.start_ns)


class LaterClock:
    """The stepped clock as read when a processor's work of `later_ns` is done."""

    def __init__(self, clock: SteppedClock, later_ns: int = 0) -> None:
        self._clock = clock
        self.later_ns = later_ns

    def now_ns(self) -> int:
        return self._clock.now_ns() + self.later_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        raise TamsError("a chain in virtual time must not sleep")

    def suspended_ns(self) -> int:
        return 0


@cache
def _test_clock_class() -> Any:
    gst.load()
    try:
        import gi

        gi.require_version("GstCheck", "1.0")
        from gi.repository import GstCheck
    except (ImportError, ValueError) as error:
        raise SetupError(
            "GStreamer's test clock is missing; run `apt-get install gir1.2-gstreamer-1.0` "
            f"({error})"
        ) from error
    return GstCheck.TestClock


@cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL("libgstreamer-1.0.so.0")


def _unreference(wait: int) -> None:
    """Give a clock id back; the binding's own call complains about what it was given."""
    _library().gst_clock_id_unref(ctypes.c_void_p(wait))

"""Time that moves on request: GStreamer's test clock, whose waits end one at a time, a queue of
actions beside it, and pipelines that run by it.
"""

from __future__ import annotations

import ctypes
import heapq
from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

from tams_app import gst
from tams_app.errors import SetupError, TamsError

Action: TypeAlias = Callable[[], None]


class EventQueue:
    """A queue of actions in the order of time, and of posting where times are equal."""

    def __init__(self) -> None:
        self._posted = 0
        self._entries: list[tuple[int, int, Action]] = []

    @property
    def next_ns(self) -> int | None:
        """The time when the next action is due [ns]; None if there is none."""
        return self._entries[0][0] if self._entries else None

    def post(self, due_ns: int, action: Action) -> None:
        self._posted += 1
        heapq.heappush(self._entries, (due_ns, self._posted, action))

    def do_next(self) -> None:
        heapq.heappop(self._entries)[2]()


class SteppedClock:
    """The clock of all pipelines of one run.

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
    """A `Clock`: the stepped one as read when a processor's work of `later_ns` is done."""

    def __init__(self, clock: SteppedClock, later_ns: int) -> None:
        self._clock, self._later_ns = clock, later_ns

    def now_ns(self) -> int:
        return self._clock.now_ns() + self._later_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        raise TamsError("a chain in virtual time must not sleep")

    def suspended_ns(self) -> int:
        return 0


class Chain:
    """A pipeline on the stepped clock; what is pushed enters its element `first`.

    What derives from it calls `play` once it has taken its elements.
    """

    def __init__(self, description: str, first: str, clock: SteppedClock, what: str) -> None:
        Gst = gst.load().Gst
        self.pipeline = gst.Pipeline(description, what)
        self._ok = Gst.FlowReturn.OK
        clock.drive(self.pipeline.elements)
        self.entrance = self.pipeline[first].get_static_pad("sink")
        self._pad = Gst.Pad.new("feed", Gst.PadDirection.SRC)
        self._pad.set_active(True)
        self._is_first = True

    def play(self, caps: str) -> None:
        """Begin, with what is pushed of these caps; SetupError if GStreamer refuses."""
        Gst = gst.load().Gst
        self.pipeline.play()
        self._pad.link(self.entrance)
        segment = Gst.Segment()
        segment.init(Gst.Format.TIME)
        for event in (
            Gst.Event.new_stream_start(self.pipeline.what),
            Gst.Event.new_caps(Gst.Caps.from_string(caps)),
            Gst.Event.new_segment(segment),
        ):
            self._pad.push_event(event)

    def push(self, buffer: Any) -> None:
        """Hand a buffer in; TamsError if the chain does not take it.

        The first is marked as such, as every source of GStreamer does: the depayloader's request
        for a keyframe at the start hangs on it.
        """
        if self._is_first:
            self._is_first = False
            buffer.set_flags(gst.load().Gst.BufferFlags.DISCONT)
        flow = self._pad.push(buffer)
        if flow != self._ok:
            reason = gst.poll_bus(self.pipeline.elements) or flow.value_nick
            raise TamsError(f"{self.pipeline.what} failed: {reason}")

    def close(self) -> None:
        """End the chain and its threads; may be called twice."""
        self._pad.set_active(False)
        self.pipeline.close()


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

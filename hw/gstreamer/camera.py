"""A camera behind a GStreamer chain: opened, watched, and opened again when frames stay away."""

from __future__ import annotations

import sys
from typing import Protocol

from hw.camera import Camera
from hw.gstreamer.capture import GstCapture, RawFrame
from hw.gstreamer.monitor import CaptureGrid, FrameStatus, FreezeWatch
from tams_app.config import VideoConfig
from tams_app.errors import DeviceError, TamsError
from tams_app.records import Frame, TakeNote
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

REOPEN_NS = NS_PER_S
_FIRST_FRAME_TIMEOUT_NS = 5 * NS_PER_S
_LOOK_NS = 50 * NS_PER_MS
_WHOLE_AGAIN_NS = 10 * NS_PER_S  # without a damaged frame: the next is reported again


class FrameSource(Protocol):
    """A device or file that frames come from; `GstCamera` opens and watches it."""

    noisy: bool
    """It is a real sensor, of which two equal frames are one frame delivered twice."""
    endless: bool
    """Its end or silence is a failure; else it has pauses, and is opened anew at once."""

    @property
    def label(self) -> str:
        """The name by which people know it, for messages."""

    def open(self) -> GstCapture:
        """Start capturing; called again after each failure.

        Returns:
            A running chain, whose frames have the size of the `VideoConfig`; the camera closes it.

        Raises:
            DeviceError: it is not there or refuses, in one sentence.
            SetupError: a GStreamer element is missing.
        """

    def complaints(self) -> list[str]:
        """Settings that the device did not keep, read once after each opening when frames come.

        Returns:
            The ends of sentences that begin with the camera's name; empty if all is well.
        """


class GstCamera(Camera):
    """A camera made of a `FrameSource`; start and close in one thread, next_frame in one other.

    A source that fails, falls silent or repeats itself is opened again about once a second, with
    the same settings; meanwhile next_frame gives None, and the stale video holds the arm. A frame
    that a sensor delivers again is left out at once, as is each that arrives damaged. Each change
    is reported once to `note`. The time grid goes on over it all, so no index comes twice.
    """

    def __init__(
        self, view: str, source: FrameSource, video: VideoConfig, clock: Clock, note: TakeNote
    ) -> None:
        """Make a camera that is not started yet.

        Args:
            view: the name that its frames carry.
            source: opened by `start`.
            video: size [pixels] and rate [frames/s] of the frames.
            clock: CLOCK_MONOTONIC, by which the frames are timed.
            note: called with level and sentence when frames stay away and when they are back.
        """
        self.view = view
        self._source = source
        self._shape = (video.height, video.width, 3)
        self._clock = clock
        self._note = note
        self._grid = CaptureGrid(video.fps)
        self._watch = FreezeWatch(source.noisy)
        self._capture: GstCapture | None = None
        self._started = False
        self._delivered = False  # a frame since the last opening
        self._reopen_ns = 0  # not before
        self.trouble = ""  # what keeps the frames away now
        self._trouble_ns = 0
        self._complained: set[str] = set()
        self._damaged = self._gate_damaged = 0  # since the frame given last, since the opening
        self._quiet_until_ns = 0  # about damage

    def start(self) -> None:
        """Open the source and wait for its first frame.

        Raises:
            DeviceError: there is none within 5 s, or the source refuses.
        """
        self._started = True
        try:
            self._await_first_frame(self._open())
        except (TamsError, OSError) as error:
            self.close()
            raise DeviceError(f"camera {self.view}: {error}") from error

    def next_frame(self, timeout_s: float) -> Frame | None:
        if not self._started:
            raise DeviceError(f"camera {self.view} was not started")
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        while True:
            capture = self._capture or self._reopen(deadline_ns)
            if capture is not None:
                until_ns = min(deadline_ns, self._silent_from_ns())
                raw = capture.pull(until_ns - self._clock.now_ns())
                self._count_damaged(capture)
                frame = self._look_at(raw) if raw else None
                if frame is not None:
                    return frame
                if raw is None:
                    self._look_after(capture)
            if self._clock.now_ns() >= deadline_ns:
                return None

    def close(self) -> None:
        self._started = False
        self._shut()

    # --- opening ------------------------------------------------------------------------------

    def _open(self) -> GstCapture:
        self._reopen_ns = self._clock.now_ns() + REOPEN_NS
        self._capture = self._source.open()
        self._delivered = False
        self._gate_damaged = 0
        self._watch.opened(self._clock.now_ns())
        return self._capture

    def _await_first_frame(self, capture: GstCapture) -> None:
        deadline_ns = self._clock.now_ns() + _FIRST_FRAME_TIMEOUT_NS
        while (raw := capture.pull(_LOOK_NS)) is None:  # a failure does not end the waiting
            if capture.ended or self._clock.now_ns() >= deadline_ns:
                reason = capture.failure or f"none within {_FIRST_FRAME_TIMEOUT_NS // NS_PER_S} s"
                if not (capture.failure or self._source.endless):  # decodebin may keep an error
                    reason = f"it is damaged, or begins late ({reason}); {self._remedy}"
                if capture.gate.damaged:
                    reason = f"all are damaged: {capture.gate.cause}; {self._remedy}"
                raise DeviceError(f"{self._source.label} gives no frame: {reason}")
        self._look_at(raw)

    def _reopen(self, deadline_ns: int) -> GstCapture | None:
        """Open the source if it is time to; else sleep until then, or until the deadline."""
        self._clock.sleep_until_ns(min(self._reopen_ns, deadline_ns))
        if self._clock.now_ns() < self._reopen_ns:
            return None
        try:
            return self._open()
        except (TamsError, OSError) as error:  # OSError: it was unplugged meanwhile
            self._report("is away", str(error))
            return None

    def _shut(self) -> None:
        if self._capture is not None:
            self._capture.close()
            self._capture = None

    # --- looking ------------------------------------------------------------------------------

    def _look_at(self, raw: RawFrame) -> Frame | None:
        now_ns = self._clock.now_ns()
        status = self._watch.frame(now_ns, raw.pixels.data)
        if status is FrameStatus.FROZEN:
            self._shut()
            self._report(status, "it is opened again until that ends")
        if status is not FrameStatus.NEW:
            return None
        self._report_recovery(now_ns)
        index = self._grid.index(raw.capture_ns)
        if index is None:
            return None
        pixels = raw.pixels.reshape(self._shape)
        damaged, self._damaged = self._damaged, 0
        return Frame(self.view, index, raw.capture_ns, pixels, ready_ns=now_ns, damaged=damaged)

    def _look_after(self, capture: GstCapture) -> None:
        """No frame came: find out whether the source is to be opened again."""
        if capture.ended:
            failure = capture.failure
            self._shut()
            if failure or self._source.endless or not self._delivered:
                self._report("failed", failure or "its frames ended")
            else:
                self._reopen_ns = 0
        elif self._clock.now_ns() >= self._silent_from_ns():
            self._shut()
            self._report(FrameStatus.SILENT, "it is opened again until they come")

    def _silent_from_ns(self) -> int:
        return self._watch.silent_from_ns() if self._source.endless else sys.maxsize

    def _count_damaged(self, capture: GstCapture) -> None:
        """Count the frames that were left out since the last look; report when that begins."""
        gate, now_ns = capture.gate, self._clock.now_ns()
        new, self._gate_damaged = gate.damaged - self._gate_damaged, gate.damaged
        self._damaged += new
        if new and now_ns > self._quiet_until_ns:
            self._warn(f"gives damaged frames, which are left out: {gate.cause}; {self._remedy}")
        if new:
            self._quiet_until_ns = now_ns + _WHOLE_AGAIN_NS

    @property
    def _remedy(self) -> str:
        on_a_bus = "check its cable, or give it a USB port and bus of its own"
        return on_a_bus if self._source.endless else "choose another file"

    # --- reporting ----------------------------------------------------------------------------

    def _report(self, trouble: str, detail: str) -> None:
        """Note `trouble` unless it is the one there was before."""
        if trouble == self.trouble:
            return
        if not self.trouble:
            self._trouble_ns = self._clock.now_ns()
        self.trouble = trouble
        self._warn(f"{trouble}: {detail}")

    def _report_recovery(self, now_ns: int) -> None:
        if not self._delivered:
            self._delivered = True
            lacks = self._capture.gate.lacks if self._capture else ""
            for complaint in (*self._source.complaints(), lacks):
                if complaint and complaint not in self._complained:
                    self._complained.add(complaint)
                    self._warn(complaint)
        if self.trouble:
            away_s = (now_ns - self._trouble_ns) / NS_PER_S
            self.trouble = ""
            self._note("info", f"camera {self.view} delivers again, after {away_s:.1f} s")

    def _warn(self, what: str) -> None:
        self._note("warning", f"camera {self.view} ({self._source.label}) {what}")

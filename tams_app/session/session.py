"""A live session as the console meets it: its start, its end, and what fails between them."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2

from hw.desk.keyboard import KeyboardController
from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.recording import Recorder
from tams_app.records import EpisodeRequest, SessionState
from tams_app.runtime.clock import Clock
from tams_app.runtime.ending import Ending
from tams_app.runtime.kept_memory import keep_freed_memory
from tams_app.runtime.parts import Parts
from tams_app.runtime.realtime import APPLICATION_PRIORITY, use_ordinary, use_round_robin
from tams_app.session.recorders import LoadMonitor, live_records
from tams_app.session.ros2_bridge import Ros2Bridge
from tams_app.session.sentences import Sentences
from tams_app.station.fresh_video import Displays
from tams_app.station.mount_memory import MountMemory
from tams_app.station.station import Station
from tams_app.video.live.frame_ring import FrameBlock


class RequestedSignals(Protocol):
    """The operator's signals to arm and log, and that the arm must not move any more."""

    pinned: str

    def confirm(self, asked_ns: int) -> None: ...

    def estop(self) -> None: ...

    def episode(self, request: EpisodeRequest) -> None: ...

    def fail(self) -> None: ...


class Side(Protocol):
    """The parts at this computer, once they have started: both sides of a session, or one."""

    @property
    def station(self) -> Station | None:
        """The station that shows frames; None: they are shown elsewhere."""

    @property
    def pids(self) -> dict[str, int]:
        """Of the processes that `Session.parts` does not watch."""

    def poll(self) -> str:
        """Look after streams and the other side; the first failure, "" while all works."""

    def state(self) -> SessionState:
        """The session's state as the console shows it now."""

    def stop_arm(self, failed: bool) -> None:
        """The first thing when a session ends; may be called twice."""

    def finish(self, reason: str, failed: bool) -> None:
        """The arm has stopped; everything else still runs."""


class Session(Ending):
    """Start it, `poll` it a few times a second until `ended`, then `close` it; once."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        signals: RequestedSignals,
        compose: Callable[[Session], Side],
    ) -> None:
        """`compose` starts what runs here, as parts of the session; TamsError if that cannot be."""
        super().__init__(clock, config.seconds)
        self.config, self.clock, self.folder = config, clock, folder
        self.signals = signals
        self.sentences = Sentences()
        self.displays = Displays()
        self.parts = Parts(folder / "helpers", self.fail, config.control.realtime_priority)
        self._compose = compose
        self._side: Side | None = None
        self._log: Recorder | None = None
        self._bridge: Ros2Bridge | None = None
        self._forward: Callable[[str], None] = lambda _text: None

    # --- start ----------------------------------------------------------------------------------

    def start(self) -> None:
        """Start everything; on failure what was started is stopped again, and the error raised."""
        parts = self.parts
        try:
            keep_freed_memory()
            cv2.setNumThreads(1)  # its other threads would spin for work longer than a frame takes
            if self.config.control.realtime_priority:
                use_round_robin(APPLICATION_PRIORITY)  # inherited by every thread made from here on
                parts.stack.callback(use_ordinary)
            parts.logs.mkdir(exist_ok=True)  # the window is there before
            self._side = self._compose(self)
        except BaseException:
            self._unwind()
            raise

    def open_log(self, config: Config) -> Recorder:
        """The session's log, with the configuration that counts."""
        self.config = config
        records = live_records(
            config,
            self.clock,
            self.folder,
            self.parts.on_failure,
            self._show_note,
            self.signals.estop,
        )
        log, self._bridge = self.parts.stack.enter_context(records)
        self._log = log
        if config.calibrated_by:
            log.note("info", f"calibrated by {', '.join(config.calibrated_by)}")
        return log

    def forward_notes(self, receive: Callable[[str], None]) -> None:
        """From now on hand each sentence for people to `receive` as well; from any thread."""
        self._forward = receive

    def ready(self, side: Side) -> None:
        """Everything is made but the control loop: monitor the load, and freeze the collector."""
        log, pids = self.log, {**self.parts.pids, **side.pids}
        if self._bridge is not None and (bridge_pid := self._bridge.pid) is not None:
            pids["ros2"] = bridge_pid
        self.parts.run("load", LoadMonitor(self.clock, pids, log).run)
        gc.collect()
        gc.freeze()  # what lives as long as the session need not be looked at again
        self.parts.stack.callback(gc.unfreeze)
        self.go_on()

    def go_on(self) -> None:
        """Between two stages of the start: TamsError if a part failed or our end was requested."""
        if self.failure or self.requested_end:
            raise TamsError(self.failure or f"{self.requested_end} before it had started")

    # --- while it runs --------------------------------------------------------------------------

    @property
    def log(self) -> Recorder:
        """Open since `open_log`."""
        assert self._log is not None, "open it first"
        return self._log

    @property
    def started(self) -> bool:
        """True once everything runs; what was recorded is worth keeping from then on."""
        return self._side is not None

    @property
    def side(self) -> Side:
        """The side that runs here, once it has started."""
        assert self._side is not None, "start it first"
        return self._side

    @property
    def screen(self) -> FrameBlock:
        """The memory of the frames shown, once it has started."""
        assert self.side.station is not None, "nothing is shown here"
        return self.side.station.screen

    @property
    def recorded_mb(self) -> float | None:
        """The size of its log so far."""
        return self.log.size_bytes / 1e6

    @property
    def mount(self) -> MountMemory | None:
        """Where the camera on the arm is, by which its frames are corrected; None: none are."""
        return None if self.side.station is None else self.side.station.mount

    @property
    def keyboard(self) -> KeyboardController | None:
        """The controller, where a window has to feed it."""
        return None if self.side.station is None else self.side.station.keyboard

    def poll(self) -> None:
        """Look after helpers, streams, the other side and the time limit. From the main thread."""
        self.parts.poll()
        if failure := self.side.poll():
            self.fail(failure)
        self.log.poll()
        self.end_if_due()

    def fail(self, sentence: str) -> None:
        """The job has failed: stop the arm, let the session end with exit code 1."""
        try:
            self.signals.fail()
        finally:
            if not self.failure:
                self.failure = sentence
                if self._log is not None:
                    self.note("error", sentence)
            self.end(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self.log.note(level, text)

    def fact(self, name: str, value: str) -> None:
        """Keep in the log what was learned; a later value of the same name counts."""
        self.log.fact(name, value)

    def state(self) -> SessionState:
        """The session's state as the console shows it now."""
        return self.side.state()

    # --- end ------------------------------------------------------------------------------------

    def stop_arm(self) -> None:
        """The first thing when a session ends; may be called twice."""
        self.side.stop_arm(bool(self.failure))

    def close(self) -> None:
        """Stop the arm, then everything else in the reverse order of its start.

        What fails on the way is kept in `failure`, unless there is one already.
        """
        side = self.side
        self.parts.stack.callback(lambda: side.finish(self.end_reason, bool(self.failure)))
        try:
            self.stop_arm()
        finally:
            self._unwind()
        if self.config.recording.episodes:
            self.require_whole_log()

    def require_whole_log(self) -> None:
        """For what is to be evaluated or learned from: one that lacks records is a failure."""
        if self._log is not None and self._log.dropped and not self.failure:
            self.failure = f"{self._log.dropped} records are missing from the log; record it again"

    def _unwind(self) -> None:
        try:
            self.parts.stack.close()
        except (TamsError, OSError) as failure:
            self.failure = self.failure or str(failure)

    def _show_note(self, text: str) -> None:
        self.sentences.note(text)
        self._forward(text)

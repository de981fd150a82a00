"""A live session as the console meets it: what is there from the outset, and the open session."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

import cv2

from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.recording import Recorder
from tams_app.recording.journal import Journal
from tams_app.records import PacketRecord, Record, SessionState
from tams_app.robot.control import Signals
from tams_app.robot.ground import LiveGround
from tams_app.runtime.clock import Clock
from tams_app.runtime.mailbox import Sentences
from tams_app.runtime.parts import Ending, Parts
from tams_app.runtime.realtime import (
    APPLICATION_PRIORITY,
    keep_freed_memory,
    use_ordinary,
    use_round_robin,
)
from tams_app.session.recorders import LoadMonitor, live_records
from tams_app.station.fresh_video import Displays
from tams_app.station.hand import OperatorHand
from tams_app.station.screen import Screen
from tams_app.video.live.frame_ring import FrameBlock

if TYPE_CHECKING:
    from hw.desk.keyboard import KeyboardController
    from tams_app.station.linked_robot import Requests
    from tams_app.station.mount_memory import MountMemory


class Spoken(Journal):
    """Before there is a log: sentences are shown, and nothing is kept."""

    def keep(self, item: Record) -> None:
        """Let it go."""

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Let them go."""


class Outset(Ending):
    """What exists before a session opens and after it closes; by it the session ends or fails.

    `run`, `robot` or `operate` opens it, once. `signals`: take the operator's confirmations and
    stops, and the session's failure. `started`: the start is complete, and the log worth keeping.
    `log`: keeps nothing until `open_log`. `records_lost`: missing from the log, known once it is
    closed.
    """

    def __init__(
        self, config: Config, clock: Clock, folder: Path, signals: Signals | Requests
    ) -> None:
        """`folder`: the session's own, which exists."""
        super().__init__(clock, config.seconds)
        self.config, self.clock, self.folder, self.signals = config, clock, folder, signals
        self.sentences, self.displays = Sentences(), Displays()
        self.log: Journal = Spoken(clock, self.sentences.note)
        self.started = False
        self.records_lost = 0

    # --- the start, and what ends with the session ----------------------------------------------

    @contextmanager
    def starting(self) -> Iterator[Parts]:
        """What is started inside is closed at the end, last first (`Parts.stack`).

        What fails at their end is kept in `failure`, unless there is one already.
        """
        logs, priority = self.folder / "helpers", self.config.control.realtime_priority
        parts = Parts(logs, self.fail, priority)
        try:
            keep_freed_memory()
            cv2.setNumThreads(1)  # its other threads would spin for work longer than a frame takes
            if priority:
                use_round_robin(APPLICATION_PRIORITY)  # inherited by every thread made from here on
                parts.stack.callback(use_ordinary)
            logs.mkdir(exist_ok=True)  # a window has made it already
            yield parts
        finally:
            try:
                parts.stack.close()
            except (TamsError, OSError) as failure:
                self.failure = self.failure or str(failure)

    def open_log(self, config: Config, parts: Parts) -> Recorder:
        """The session's log, with the configuration that counts."""
        self.config = config
        log = parts.stack.enter_context(self._recorded(config, parts))
        self.log = log
        if config.calibrated_by:
            log.note("info", f"calibrated by {', '.join(config.calibrated_by)}")
        return log

    def ground(self, parts: Parts, log: Journal, arm_at_once: bool, dry_run: bool) -> LiveGround:
        """What the robot's side stands on, where that is here."""
        assert isinstance(self.signals, Signals), "the arm is here"
        return LiveGround(
            self.config, self.clock, log, self.signals, parts, self, arm_at_once, dry_run
        )

    def ready(self, parts: Parts) -> None:
        """Everything is made but the control loop: monitor the load, and freeze the collector."""
        parts.run("load", LoadMonitor(self.clock, parts.pids, self.log).run)
        gc.collect()
        gc.freeze()  # what lives as long as the session need not be looked at again
        parts.stack.callback(gc.unfreeze)
        self.go_on()

    def go_on(self) -> None:
        """Between two stages of the start: TamsError if a part failed or an end was requested."""
        if self.failure or self.requested_end:
            raise TamsError(self.failure or f"{self.requested_end} before it had started")

    @contextmanager
    def _recorded(self, config: Config, parts: Parts) -> Iterator[Recorder]:
        records = live_records(
            config,
            self.clock,
            self.folder,
            parts.on_failure,
            self.sentences,
            self.signals,
        )
        with records as (log, bridge):
            if bridge is not None and bridge.pid is not None:
                parts.measure("ros2", bridge.pid)
            yield log
        self.records_lost = log.dropped
        if self.started and config.recording.episodes:
            self.require_whole_log()

    # --- at any time, from any thread -----------------------------------------------------------

    def fail(self, sentence: str) -> None:
        """The job has failed: stop the arm, let the session end with exit code 1."""
        try:
            self.signals.fail()
        finally:
            if not self.failure:
                self.failure = sentence
                self.note("error", sentence)
            self.end(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self.log.note(level, text)

    def fact(self, name: str, value: str) -> None:
        """Keep in the log what was learned; a later value of the same name counts."""
        self.log.fact(name, value)

    def require_whole_log(self) -> None:
        """For what is to be evaluated or learned from: one that lacks records is a failure."""
        if self.records_lost and not self.failure:
            self.failure = f"{self.records_lost} records are missing from the log; record it again"


class Side(Protocol):
    """The parts at this computer: both sides of a session, or one."""

    def poll(self) -> str:
        """Look after streams and the other side; the first failure, "" while all works."""

    def state(self) -> SessionState:
        """The session's state as the console shows it now."""

    def stop_arm(self, failed: bool) -> None:
        """Comes first when a session ends; from any thread, any number of times."""

    def finish(self, reason: str, failed: bool) -> None:
        """The arm's stop is sent; everything else still runs."""


class Session:
    """An open session: `poll` it a few times a second until it has ended; a context.

    At its end the arm is stopped, `finish` is called, then all else ends in reverse (`starting`).
    """

    def __init__(
        self,
        outset: Outset,
        parts: Parts,
        log: Recorder,
        side: Side,
        screen: Screen | None = None,
        hand: OperatorHand | None = None,
    ) -> None:
        """`side` runs. `screen`, `hand`: of the operator; None: they are elsewhere."""
        self._outset, self._parts, self._log = outset, parts, log
        self.side, self._screen, self._hand = side, screen, hand
        self.config, self.folder, self.signals = outset.config, outset.folder, outset.signals
        self.sentences, self.displays = outset.sentences, outset.displays
        self.ended = outset.ended
        outset.started = True

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._parts.stack.callback(self._finish)
        self.stop_arm()

    @property
    def screen(self) -> FrameBlock:
        """The memory of the frames shown."""
        assert self._screen is not None, "nothing is shown here"
        return self._screen.frames

    @property
    def mount(self) -> MountMemory | None:
        """Where the camera on the arm is, by which its frames are corrected; None: none are."""
        return None if self._screen is None else self._screen.mount

    @property
    def keyboard(self) -> KeyboardController | None:
        """The controller, where a window has to feed it."""
        return None if self._hand is None else self._hand.keyboard

    @property
    def recorded_mb(self) -> float | None:
        """The size of its log so far."""
        return self._log.size_bytes / 1e6

    def poll(self) -> None:
        """Look after helpers, streams, the other side and the time limit. From the main thread."""
        self._parts.poll()
        if failure := self.side.poll():
            self.fail(failure)
        self._log.poll()
        self._outset.end_if_due()

    def state(self) -> SessionState:
        """The session's state as the console shows it now."""
        return self.side.state()

    def stop_arm(self) -> None:
        """Comes first when a session ends; from any thread, any number of times."""
        self.side.stop_arm(bool(self._outset.failure))

    def end(self, reason: str) -> None:
        """Let it end; the first reason counts."""
        self._outset.end(reason)

    def fail(self, sentence: str) -> None:
        """It has failed: stop the arm, let it end with exit code 1."""
        self._outset.fail(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self._outset.note(level, text)

    def elapsed_s(self) -> float:
        """Seconds since the session began."""
        return self._outset.elapsed_s()

    def _finish(self) -> None:
        self.side.finish(self._outset.end_reason, bool(self._outset.failure))

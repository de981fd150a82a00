"""One trial in virtual time: every part of a session, from first frame to verdict and summary."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.recording import LOG_NAME, read_log
from tams_app.recording.writer import DirectRecorder
from tams_app.records import Outcome, PhaseChange, ShownFrame
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.kept_memory import keep_freed_memory
from tams_app.session import build
from tams_app.session.control import Signals
from tams_app.session.devices import ConnectedDevices
from tams_app.session.engine import Engine
from tams_app.session.folder import furnish_session_folder
from tams_app.session.listener import Listener
from tams_app.session.observers import TRIAL_RATE_HZ
from tams_app.session.recorders import SessionRecords, session_header
from tams_app.session.viewing import viewers_of
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.rig import VirtualCameras, VirtualRobot
from tams_app.session.virtual.video import FrameScores, TrialVideo
from tams_app.study.plan import PlannedTrial
from tams_app.summary.summarise import save_summary
from tams_app.units import NS_PER_S
from tams_app.video.virtual.event_queue import EventQueue

START_NS = NS_PER_S
ENGAGED_WITHIN_S = 30.0  # else they never will: they need about three


def run_virtual_trial(
    config: Config, participant_seed: int, folder: Path, wall_start_ns: int
) -> Outcome:
    """Run one trial to its end; session.mcap, config.yaml and summary.json are in `folder` then.

    In the main thread of a process that does nothing else (`tams_app.video.virtual`).
    `wall_start_ns`: when it began by the wall's clock, for the log's header. The same arguments
    leave the same bytes on the same machine.
    """
    keep_freed_memory()
    cv2.setNumThreads(1)
    furnish_session_folder(config, folder)
    trial = VirtualTrial(config, participant_seed, folder, wall_start_ns)
    try:
        outcome = trial.run()
    finally:
        trial.close()
    save_summary(read_log(folder / LOG_NAME), folder)
    return outcome


@dataclass(frozen=True, slots=True)
class SimulatedTrialRunner:
    """Runs a study's trials in virtual time; a `TrialRunner` for `study run --sim`.

    One process per trial, one core per process. The logs are kept without bitstream and pictures.
    """

    config: Config  # the study's

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        kept = {"bitstream": False, "pictures_per_s": 0.0}
        recording = self.config.recording.model_copy(update=kept)
        config = trial.configure(self.config).model_copy(update={"recording": recording})
        gc.freeze()  # what was imported lives as long as the process
        run_virtual_trial(config, trial.participant_seed, folder, time.time_ns())


class VirtualTrial(Listener):
    """One engine and the events that move it; `run` it once, then `close`."""

    def __init__(
        self,
        config: Config,
        participant_seed: int,
        folder: Path,
        wall_start_ns: int,
        watch: Callable[[ShownFrame], None] = lambda _shown: None,
    ) -> None:
        """`watch` sees every frame that reaches the operator's screen.

        SetupError, ConfigError, LogError or DeviceError say why it cannot begin.
        """
        build.check_names(config)
        build.check_ready_pose(config)
        if config.recording.record_reference:
            raise ConfigError(
                "recording.record_reference: a trial in virtual time keeps no lossless captures; "
                "set it to false"
            )
        self._config = config
        self._clock = VirtualClock(START_NS)
        self._events = EventQueue()
        self._ended = ""
        with ExitStack() as stack:
            self._log = self._open_log(folder, wall_start_ns, stack)
            self._robot = VirtualRobot(config, self._clock, self._log.note)
            video = config.video
            self._scores = scores = FrameScores(
                video.views if video.quality.enabled else (), self._log.record
            )

            def shown(frame: ShownFrame) -> None:
                scores.shown(frame)
                watch(frame)

            self._operator = operator = VirtualOperator(config, participant_seed, self._log, shown)
            self._video = TrialVideo(config, self._clock, self._log, scores.captured, operator.see)
            stack.callback(self._video.close)
            self._cameras = VirtualCameras(config, self._robot, self._events, self._video.push)
            stack.callback(self._cameras.close)
            robot = self._robot
            self._engine = Engine(
                config,
                self._clock,
                ConnectedDevices(robot.arm, robot.gate, robot.truth),
                operator,
                self._video,
                self._log,
                Signals(),
                lambda: self._end("the trial is over"),
                (self,),
            )
            self._stack = stack.pop_all()

    def run(self) -> Outcome:
        """From the start to the verdict."""
        self._begin()
        while not self._ended:
            due_ns = self._events.next_ns
            assert due_ns is not None, "cameras and control always have something to do"
            self._video.advance_to(due_ns)
            self._clock.sleep_until_ns(due_ns)
            self._events.do_next()
        self._robot.stop()
        self._engine.stops.finish()
        self._scores.finish(self._clock.now_ns())
        outcome = self._engine.trial.outcome(self._ended)
        self._log.record(outcome)
        return outcome

    def close(self) -> None:
        """Finish the log and give everything back; may be called twice."""
        self._stack.close()

    def _open_log(self, folder: Path, wall_start_ns: int, stack: ExitStack) -> SessionRecords:
        config, clock = self._config, self._clock
        header = session_header(config, START_NS, wall_start_ns - START_NS)
        keeping = config.recording
        viewers = viewers_of(config, live=False)
        log = DirectRecorder(
            folder / LOG_NAME, header, clock, keeping.min_free_mb, keeping.bitstream, viewers
        )
        stack.callback(log.close)
        return SessionRecords(clock, log)

    # --- what is due when -----------------------------------------------------------------------

    def _begin(self) -> None:
        now_ns = self._clock.now_ns()
        self._robot.arm.connect()
        self._engine.begin("virtual")
        self._log.fact("operator", self._operator.kind)
        self._cameras.start(now_ns)
        self._events.post(now_ns, self._step_policy)
        repeat(self._events, now_ns, self._config.control.rate_hz, self._tick)
        repeat(self._events, now_ns, TRIAL_RATE_HZ, lambda _due_ns: self._engine.trial.look())
        self._events.post(now_ns + round(ENGAGED_WITHIN_S * NS_PER_S), self._give_up)
        if (limit_s := self._config.seconds) is not None:
            end = partial(self._end, f"ended after {limit_s:g} s")
            self._events.post(now_ns + round(limit_s * NS_PER_S), end)

    def _tick(self, due_ns: int) -> None:
        self._operator.look(due_ns)
        self._engine.control.tick(due_ns)
        self._robot.gate.serve()

    def _step_policy(self) -> None:
        """Step if it is due, and again in time; what a phase change has outdated ends here."""
        policy = self._engine.policy
        before_ns = policy.due_ns
        policy.step_if_due()
        if policy.due_ns != before_ns:
            self._events.post(policy.due_ns, self._step_policy)

    def on_phase(self, change: PhaseChange) -> None:
        """The policy loop has been woken: let it step."""
        self._events.post(change.t_ns, self._step_policy)

    def _give_up(self) -> None:
        if not self._engine.trial.started:
            self._end("the operator never engaged")

    def _end(self, reason: str) -> None:
        """The first reason counts."""
        self._ended = self._ended or reason


def repeat(
    events: EventQueue, now_ns: int, rate_hz: float, action: Callable[[int], object]
) -> None:
    """Do `action` with its due time `rate_hz` times a second, first one period after `now_ns`."""
    period_ns = round(NS_PER_S / rate_hz)

    def again(due_ns: int) -> None:
        events.post(due_ns + period_ns, partial(again, due_ns + period_ns))
        action(due_ns)

    events.post(now_ns + period_ns, partial(again, now_ns + period_ns))

"""One trial in virtual time: every part of a session, from first frame to verdict and summary."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.recording import read_log
from tams_app.recording.direct import DirectRecorder
from tams_app.records import Note, Outcome, Phase, PhaseChange, ShownFrame
from tams_app.runtime.clock import NS_PER_S, VirtualClock
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.folder import save_config
from tams_app.session.observer import TickObserver
from tams_app.session.recorders import LOG_NAME, SessionRecords, session_header
from tams_app.session.signals import Signals
from tams_app.session.status import StatusBoard
from tams_app.session.stops import StopWatch
from tams_app.session.trial_loop import RATE_HZ, TrialLoop
from tams_app.session.virtual.cameras import VirtualCameras
from tams_app.session.virtual.hand import make_hand
from tams_app.session.virtual.rhythm import repeat
from tams_app.session.virtual.robot import VirtualRobot
from tams_app.session.virtual.streaming import VirtualStreaming
from tams_app.study.trial import TrialJudge
from tams_app.summary.file import save_summary
from tams_app.teleop.safety import ArmingState
from tams_app.video.virtual_time.event_queue import EventQueue

START_NS = NS_PER_S
ENGAGED_WITHIN_S = 30.0  # else the operator never will: he needs about three


def run_virtual_trial(
    config: Config, participant_seed: int, folder: Path, wall_start_ns: int
) -> Outcome:
    """Run one trial to its end; session.mcap, config.yaml and summary.json are in `folder` then.

    In the main thread of a process that does nothing else (`tams_app.video.virtual_time`).
    `wall_start_ns`: when it began by the wall's clock, for the log's header. The same arguments
    leave the same bytes on the same machine.
    """
    save_config(config, folder)
    trial = VirtualTrial(config, participant_seed, folder, wall_start_ns)
    try:
        outcome = trial.run()
    finally:
        trial.close()
    save_summary(read_log(folder / LOG_NAME), folder)
    return outcome


class VirtualTrial:
    """The parts of one trial and the events that moves them; `run` it once, then `close`."""

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
            self._records = self._open_log(folder, wall_start_ns, stack)
            self._robot = VirtualRobot(config, self._clock, self._note)
            self._streaming = VirtualStreaming(config, self._clock, self._records, watch)
            stack.callback(self._streaming.close)
            self._cameras = VirtualCameras(config, self._robot, self._events, self._streaming.push)
            stack.callback(self._cameras.close)
            self._hand = make_hand(
                config, participant_seed, self._streaming.frames, self._records.record
            )
            self._judge = TrialJudge(config.trial, build.task_geometry())
            self._stops = StopWatch(self._records.record)
            self._control = self._build_control()
            self._trial_loop = self._build_trial_loop()
            self._stack = stack.pop_all()

    def run(self) -> Outcome:
        """From the start to the verdict."""
        self._begin()
        while not self._ended:
            due_ns = self._events.next_ns
            assert due_ns is not None, "cameras and control always have something to do"
            self._streaming.advance_to(due_ns)
            self._clock.sleep_until_ns(due_ns)
            self._events.do_next()
        self._robot.stop()
        self._stops.finish()
        self._streaming.finish(self._clock.now_ns())
        outcome = self._judge.outcome(self._ended)
        self._records.record(outcome)
        return outcome

    def close(self) -> None:
        """Finish the log and give everything back; may be called twice."""
        self._stack.close()

    # --- building -------------------------------------------------------------------------------

    def _open_log(self, folder: Path, wall_start_ns: int, stack: ExitStack) -> SessionRecords:
        config, clock = self._config, self._clock
        header = session_header(config, START_NS, wall_start_ns - START_NS)
        keeping = config.recording
        log = DirectRecorder(
            folder / LOG_NAME, header, clock, keeping.min_free_mb, keeping.bitstream
        )
        stack.callback(log.close)
        return SessionRecords(clock, log)

    def _build_control(self) -> ControlLoop:
        gate, signals = self._robot.gate, Signals()
        observer = TickObserver(
            NoGuard(),
            self._judge,
            self._stops,
            StatusBoard(self._config.video.views),
            signals,
            self._note,
            arm_at_once=False,
        )
        hooks = ControlHooks(
            beat=lambda _now_ns: None,
            video_age_ns=self._streaming.primary_age_ns,
            stop=gate.stop,
            request=gate.request,
            arm_ready=lambda: gate.ready,
            phase_began=self._on_phase,
            record=self._records.record,
            output=observer.observe,
        )
        delay_ns = self._streaming.video_delay_ns
        return build.control_loop(
            self._config, self._clock, self._hand.controller, self._robot.arm, delay_ns, signals,
            hooks,
        )  # fmt: skip

    def _build_trial_loop(self) -> TrialLoop:
        return TrialLoop(
            self._clock,
            self._judge,
            self._robot.truth,
            self._robot.gripper_closed,
            self._records.record,
            ended=lambda: self._end("the trial is over"),
        )

    # --- what is due when -----------------------------------------------------------------------

    def _begin(self) -> None:
        now_ns = self._clock.now_ns()
        self._robot.arm.connect()
        self._hand.controller.start()
        self._records.fact("scheduler", "virtual")
        self._records.phase(PhaseChange(now_ns, Phase.REACH, "start"))
        self._cameras.start(now_ns)
        self._events.post(now_ns, self._step_policy)
        repeat(self._events, now_ns, self._config.control.rate_hz, self._tick)
        repeat(self._events, now_ns, RATE_HZ, lambda _due_ns: self._trial_loop.look())
        self._events.post(now_ns + round(ENGAGED_WITHIN_S * NS_PER_S), self._give_up)
        if (limit_s := self._config.seconds) is not None:
            end = partial(self._end, f"ended after {limit_s:g} s")
            self._events.post(now_ns + round(limit_s * NS_PER_S), end)

    def _tick(self, due_ns: int) -> None:
        self._hand.prepare(due_ns)
        self._control.tick(due_ns)
        self._robot.gate.serve()

    def _step_policy(self) -> None:
        """Step if it is due, and again in time; what a phase change has outdated ends here."""
        policy = self._streaming.policy
        before_ns = policy.due_ns
        policy.step_if_due()
        if policy.due_ns != before_ns:
            self._events.post(policy.due_ns, self._step_policy)

    def _on_phase(self, change: PhaseChange) -> None:
        self._records.phase(change)
        self._streaming.policy.enter(change.phase)
        self._events.post(change.t_ns, self._step_policy)

    def _give_up(self) -> None:
        if not self._judge.started:
            self._end("the operator never engaged")

    def _end(self, reason: str) -> None:
        """The first reason counts."""
        self._ended = self._ended or reason

    def _note(self, level: str, text: str) -> None:
        self._records.record(Note(self._clock.now_ns(), level, text))


class NoGuard:
    """There is no guard process: in virtual time no control loop falls silent."""

    def follow(self, arming: ArmingState, stopping: bool) -> None:
        """Nobody watches."""

"""One session: every part built from the configuration, started, watched and stopped in order."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hw.arm import Arm
from hw.boundary import session_boundary
from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.records import (
    Activity,
    Note,
    Phase,
    PhaseChange,
    SceneTruth,
    ShownFrame,
    Tick,
)
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S, Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import APPLICATION_PRIORITY, use_fifo, use_ordinary, use_round_robin
from tams_app.runtime.worker import Worker
from tams_app.session import build
from tams_app.session.arm_gate import ArmGate
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.guarding import Guarding
from tams_app.session.load import LoadMonitor
from tams_app.session.observer import TickObserver
from tams_app.session.recorders import Recorders
from tams_app.session.signals import Signals
from tams_app.session.status import StatusBoard, StatusSnapshot
from tams_app.session.stops import StopWatch
from tams_app.session.streaming import Streaming
from tams_app.session.trial_loop import TrialLoop
from tams_app.study.trial import Trial, TrialJudge, UnjudgedTrial
from tams_app.teleop.safety import Reason

STOP_PATIENCE_NS = 300 * NS_PER_MS
STOP_POLL_NS = 10 * NS_PER_MS
LOGGED_AFTER_NS = 30 * NS_PER_MS  # a few ticks
CONTROL_PATIENCE_S = 0.1
SUPERVISOR_PATIENCE_S = 10.0  # enabling the arm may be under way


class Session:
    """Start it, `poll` it a few times a second until `ended`, then `close` it; once."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        arm_at_once: bool = False,
        dry_run: bool = False,
    ) -> None:
        """`dry_run`: everything but motion, the arm's commands go to a model of it."""
        self.config = config
        self.folder = folder
        self.signals = Signals()
        self.ended = threading.Event()
        self.failure = ""  # why the job failed, in one sentence
        self._clock = clock
        self._arm_at_once = arm_at_once
        self._dry_run = dry_run
        self._end_reason = ""
        self._requested_end = ""
        self._stack = ExitStack()
        self._helpers: dict[str, HelperProcess] = {}
        self._trial: Trial = UnjudgedTrial()
        self._started_ns = clock.now_ns()
        self._arm: Arm | None = None
        self._gate: ArmGate | None = None
        self._control: Worker | None = None
        self.board = StatusBoard(config.video.views)

    # --- start ----------------------------------------------------------------------------------

    def start(self) -> None:
        """Start everything; on failure what was started is stopped again, and the error raised."""
        try:
            self._start()
        except BaseException:
            self._unwind()
            raise

    def _start(self) -> None:
        config, clock = self.config, self._clock
        if config.control.realtime_priority:
            use_round_robin(APPLICATION_PRIORITY)  # inherited by every thread made from here on
            self._stack.callback(use_ordinary)
        helper_logs = self.folder / "helpers"
        helper_logs.mkdir()
        self._recorders = Recorders(config, clock, self.folder, self._on_worker_failure)
        self._stack.callback(self._recorders.close)
        self._record = self._recorders.record
        if config.calibrated_by:
            self.note("info", f"calibrated by {', '.join(config.calibrated_by)}")
        self._devices = build.devices(config, clock, helper_logs, self._arm_at_once)
        self._stack.callback(self._devices.close)
        self._devices.start()
        self._streaming = Streaming(
            config, clock, self._recorders, self.board, self._on_worker_failure, self.note
        )
        self._stack.callback(self._streaming.close)
        self._streaming.start(helper_logs)
        self._go_on()
        self._devices.wait_ready()
        self._helpers.update(self._devices.helpers)
        self._go_on()
        arm, gate = self._start_arm(helper_logs)
        self._go_on()
        self._start_workers(arm, gate)
        gc.collect()
        gc.freeze()  # what lives as long as the session need not be looked at again
        self._stack.callback(gc.unfreeze)
        control = self._build_control(arm, gate)
        self._go_on()
        self._control = self._run("control", lambda stop: self._control_thread(control, stop))

    def _go_on(self) -> None:
        """Between two stages of the start: TamsError if a part failed or we were told to end."""
        if self.failure or self._requested_end:
            raise TamsError(self.failure or f"{self._requested_end} before it had started")

    def _start_arm(self, helper_logs: Path) -> tuple[Arm, ArmGate]:
        self._guarding = Guarding(self._devices.arm_config(), helper_logs, self.signals, self.note)
        self._stack.callback(self._guarding.close)
        self._guarding.start()
        arm = self._devices.make_arm()
        if self._dry_run:
            arm = build.dry_run(arm, self.config, self._clock)
            self.note("warning", "dry run: the arm does not move, its commands go to a model of it")
        self._stack.callback(arm.close)
        arm.connect()
        self._hurry(arm.realtime_thread_ids)
        boundary = session_boundary(self.config.arm, self.config.limits)
        gate = ArmGate(arm, build.servo(self.config), boundary, self.note)
        self._arm, self._gate = arm, gate
        self._guarding.wait_ready()
        self._helpers["guard"] = self._guarding.process
        self._controller = self._devices.make_controller(self.note)
        self._stack.callback(self._controller.close)
        self._controller.start()
        self._hurry(self._controller.realtime_thread_ids)
        return arm, gate

    def _hurry(self, thread_ids: Mapping[str, int]) -> None:
        """Real-time priority, just below the control loop's, for what it waits for."""
        if priority := self.config.control.realtime_priority:
            for thread_id in thread_ids.values():
                use_fifo(priority - 1, thread_id)

    def _start_workers(self, arm: Arm, gate: ArmGate) -> None:
        self._stops = StopWatch(self._record)
        self._stack.callback(self._stops.finish)
        self._run("arm-supervisor", gate.run, SUPERVISOR_PATIENCE_S)
        self._streaming.run(self._devices.make_cameras(self.note), self._run)
        self._run("load", LoadMonitor(self._clock, self._helper_pids(), self._record).run)
        if self._devices.truth is not None:
            self._run("trial", self._build_trial(arm, self._devices.truth).run)

    def _helper_pids(self) -> dict[str, int]:
        pids = {name: process.pid for name, process in self._helpers.items()}
        pids.update(self._streaming.helper_pids)
        return {name: pid for name, pid in pids.items() if pid is not None}

    def _build_control(self, arm: Arm, gate: ArmGate) -> ControlLoop:
        config = self.config
        observer = TickObserver(
            self._guarding,
            self._trial,
            self._stops,
            self.board,
            self.signals,
            self.note,
            self._arm_at_once,
        )
        hooks = ControlHooks(
            beat=self._guarding.beat,
            video_age_ns=self._streaming.primary_age_ns,
            stop=gate.stop,
            request=gate.request,
            arm_ready=lambda: gate.ready,
            phase_began=self._on_phase,
            record=self._keep_tick,
            output=observer.observe,
        )
        delay_ns = self._streaming.video_delay_ns
        return build.control_loop(
            config, self._clock, self._controller, arm, delay_ns, self.signals, hooks
        )

    def _build_trial(self, arm: Arm, truth: Callable[[], SceneTruth | None]) -> TrialLoop:
        self._trial = judge = TrialJudge(self.config.trial, build.task_geometry())
        return TrialLoop(
            self._clock,
            judge,
            truth,
            lambda: state.gripper_closed if (state := arm.state()) else None,
            self._record,
            ended=lambda: self.end("the trial is over"),
        )

    def _run(
        self, name: str, body: Callable[[threading.Event], None], patience_s: float = 2.0
    ) -> Worker:
        worker = Worker(name, body, self._on_worker_failure)
        self._stack.callback(worker.stop, patience_s)
        worker.start()
        return worker

    def _control_thread(self, control: ControlLoop, stop: threading.Event) -> None:
        scheduler = use_fifo(self.config.control.realtime_priority)
        self._recorders.fact("scheduler", scheduler.split(":")[0])
        if scheduler != "fifo":
            self.note("warning", f"control runs without real-time priority, {scheduler}")
        self._recorders.phase(PhaseChange(self._clock.now_ns(), Phase.REACH, "start"))
        control.run(stop)

    # --- while it runs --------------------------------------------------------------------------

    def poll(self) -> None:
        """Look after what nobody else does: helpers, pipelines, the clock. From the main thread."""
        for name, process in self._helpers.items():
            if process.exit_code is not None:
                self.fail(f"the helper process {name} ended unasked; see {self.folder}/helpers")
        if failure := self._streaming.poll():
            self.fail(failure)
        if self._requested_end:
            self.end(self._requested_end)
        limit_s = self.config.seconds
        if limit_s is not None and self.elapsed_s() >= limit_s:
            self.end(f"ended after {limit_s:g} s")

    def elapsed_s(self) -> float:
        """Seconds since the session began."""
        return (self._clock.now_ns() - self._started_ns) / NS_PER_S

    def end(self, reason: str) -> None:
        """Let the session end; the first reason counts. From any thread."""
        if not self.ended.is_set():
            self._end_reason = reason
            self.ended.set()

    def request_end(self, reason: str) -> None:
        """As `end`, for signal handlers: takes no lock, the next `poll` sees to it."""
        self._requested_end = reason

    def fail(self, sentence: str) -> None:
        """The job has failed: stop the arm, let the session end with exit code 1."""
        self.signals.fault(Reason.SESSION_FAILED)
        if self._gate is not None:
            self._gate.stop()
        if not self.failure:
            self.failure = sentence
            self.note("error", sentence)
        self.end(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self.board.note(text)
        self._record(Note(self._clock.now_ns(), level, text))

    def shown(self, view: str) -> ShownFrame | None:
        """The newest frame of `view`, for a window."""
        return self._streaming.shown(view)

    def snapshot(self) -> StatusSnapshot:
        """What the console shows at this moment."""
        return self._streaming.snapshot(self._clock.now_ns(), self.elapsed_s())

    def stop_arm(self) -> None:
        """Stop the arm: the first thing when a session ends; may be called twice.

        The control loop ends before, or it would take our stop for a fault; if it hangs, the stop
        is sent all the same.
        """
        arm, gate, control = self._arm, self._gate, self._control
        if arm is None or gate is None:
            return
        if control is not None:
            if self.failure:
                self._await_stop(arm, control)  # so that the log shows how the arm stopped
            control.request_stop()
            control.join(CONTROL_PATIENCE_S)
        gate.stop()

    def close(self) -> None:
        """Stop the arm, then everything else in the reverse order of its start.

        What fails on the way is kept in `failure`, unless there is one already.
        """
        try:
            self.stop_arm()
            self._record(self._trial.outcome(self._end_reason))
        finally:
            self._unwind()

    def _unwind(self) -> None:
        try:
            self._stack.close()
        except (TamsError, OSError) as failure:
            self.failure = self.failure or str(failure)

    def _await_stop(self, arm: Arm, control: Worker) -> None:
        """Wait, but not for long, until the log has the arm's report that it has stopped."""
        deadline_ns = self._clock.now_ns() + STOP_PATIENCE_NS
        while control.alive and self._clock.now_ns() < deadline_ns:
            state = arm.state()
            if state is not None and state.activity is Activity.STOPPED:
                deadline_ns = min(deadline_ns, state.received_ns + LOGGED_AFTER_NS)
            self._clock.sleep_until_ns(self._clock.now_ns() + STOP_POLL_NS)

    # --- called by the parts --------------------------------------------------------------------

    def _on_worker_failure(self, name: str, failure: BaseException) -> None:
        sentence = str(failure) if isinstance(failure, TamsError) else f"{name}: {failure!r}"
        self.fail(sentence)

    def _keep_tick(self, tick: Tick) -> None:
        self.board.buttons(tick.controller)
        self._record(tick)

    def _on_phase(self, change: PhaseChange) -> None:
        self._recorders.phase(change)
        self.board.phase = change.phase
        self._streaming.enter(change.phase)

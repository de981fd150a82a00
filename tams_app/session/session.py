"""The live session: threads and helper processes around the engine, and their order."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

import cv2
import msgspec

from hw.arm import Arm
from hw.boundary import session_boundary
from hw.controller import Controller
from hw.desk.keyboard import KeyboardController
from hw.make_controller import keyboard_of
from tams_app.config import Config, Network
from tams_app.errors import TamsError
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Activity, PacketRecord, SessionState, ShownFrame, ViewState
from tams_app.runtime.clock import Clock
from tams_app.runtime.kept_memory import keep_freed_memory
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import APPLICATION_PRIORITY, use_fifo, use_ordinary, use_round_robin
from tams_app.runtime.worker import Worker
from tams_app.session import build
from tams_app.session.arm_gate import ArmGate
from tams_app.session.awake import KeptAwake
from tams_app.session.control import Signals
from tams_app.session.devices import ConnectedDevices, Devices
from tams_app.session.dry_run import DryRunArm
from tams_app.session.ending import Ending
from tams_app.session.engine import Engine
from tams_app.session.frame_rates import FrameRates
from tams_app.session.guarding import Guarding
from tams_app.session.listener import Listener
from tams_app.session.quality import LiveQuality
from tams_app.session.recorders import LoadMonitor, Recorders
from tams_app.session.sentences import Sentences
from tams_app.session.status import StatusBoard
from tams_app.session.uplink import Capture, Senders, Uplink
from tams_app.teleop.hands import hand_of
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import Codecs
from tams_app.video.live.codec_choice import choose_codecs
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tams_app.video.live.networks import resolve_network

STOP_TIMEOUT_NS = 300 * NS_PER_MS
STOP_POLL_NS = 10 * NS_PER_MS
LOGGED_AFTER_NS = 30 * NS_PER_MS  # a few ticks
CONTROL_TIMEOUT_S = 0.1
GATE_TIMEOUT_S = 10.0  # enabling the arm may be under way


class Session(Ending):
    """Start it, `poll` it a few times a second until `ended`, then `close` it; once."""

    operator_is_here = True  # at this computer

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        arm_at_once: bool = False,
        dry_run: bool = False,
    ) -> None:
        """`dry_run`: everything but motion, the arm's commands go to a model of it."""
        super().__init__(config, clock)
        self.folder = folder
        self.signals = Signals()
        self._arm_at_once = arm_at_once
        self._dry_run = dry_run
        self._stack = ExitStack()
        self._helpers: dict[str, HelperProcess] = {}
        self._arm: Arm | None = None
        self.keyboard: KeyboardController | None = None  # which the console's window has to feed
        self._gate: ArmGate | None = None
        self._control: Worker | None = None
        self.sentences = Sentences()
        self._board = StatusBoard(
            config.video.views, WeightMatrix(config.policy.weights.matrix), config.video.fps
        )

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
        keep_freed_memory()
        cv2.setNumThreads(1)  # its other threads would spin for work longer than a frame takes
        if config.control.realtime_priority:
            use_round_robin(APPLICATION_PRIORITY)  # inherited by every thread made from here on
            self._stack.callback(use_ordinary)
        helper_logs = self.folder / "helpers"
        helper_logs.mkdir(exist_ok=True)  # the window is there before
        failed = self._on_worker_failure
        self._log = Recorders(
            config, clock, self.folder, failed, self._show_note, self.signals.estop
        )
        self._stack.callback(self._log.close)
        awake = KeptAwake(lambda text: self.note("warning", text))
        self._stack.callback(awake.close)
        if not config.rig.enabled:
            awake.start()
        if config.calibrated_by:
            self.note("info", f"calibrated by {', '.join(config.calibrated_by)}")
        ladder = build.rate_ladder(config)
        video = config.video
        self.screen = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        self._stack.callback(self.screen.close)
        self._devices = self._make_devices(helper_logs)
        self._stack.callback(self._devices.close)
        self._devices.start()
        if ladder is not None:
            self._devices.ask_fps(ladder.fps)
        self._start_video(helper_logs)
        self._rates = FrameRates(
            config,
            clock,
            ladder,
            self._devices.ask_fps,
            self._video.behind_ns,
            self._log.record,
            self.note,
        )
        cameras = self._stack.enter_context(ExitStack())  # closed after arm and controller
        self._go_on()
        self._devices.wait_ready()
        self.screen.hide()  # all who read it have it open
        self._helpers.update(self._devices.helpers)
        self._go_on()
        connected = self._connect_devices(helper_logs)
        self._go_on()
        self._engine = Engine(
            config,
            clock,
            connected,
            self._video,
            self._log,
            self.signals,
            lambda: self.end("the trial is over"),
            (self._board, self._rates, *self._listeners()),
            self._hand,
            self._arm_at_once,
            self._trial_is_limited,
            lambda: self.note("info", "the block is placed: go on, or press q to end the session"),
        )
        self._stack.callback(self._engine.stops.finish)
        self._start_workers(connected, cameras)
        gc.collect()
        gc.freeze()  # what lives as long as the session need not be looked at again
        self._stack.callback(gc.unfreeze)
        self._go_on()
        self._control = self._run("control", self._control_thread)

    def _go_on(self) -> None:
        """Between two stages of the start: TamsError if a part failed or we were told to end."""
        if self.failure or self._requested_end:
            raise TamsError(self.failure or f"{self._requested_end} before it had started")

    def _start_video(self, helper_logs: Path) -> None:
        config, log = self.config, self._log
        self._quality = LiveQuality(config.video, self.screen, helper_logs, log.record, self.note)
        self._stack.callback(self._quality.close)
        self._quality.start()  # takes a moment, of which a capacity trace must lose nothing
        codecs = choose_codecs(config.video, build.starts_at_capacity(config))
        for remark in codecs.remarks:
            self.note("warning", remark)
        network = resolve_network(config, config.network)
        self._video = self._make_video(network, codecs, helper_logs)
        self._stack.callback(self._video.close)
        self._video.start()

    # --- what a session with its operator elsewhere has of its own --------------------------------

    def _make_devices(self, helper_logs: Path) -> Devices:
        return build.devices(
            self.config,
            self._clock,
            helper_logs,
            self._log,
            self.screen,
            self._on_worker_failure,
            self._arm_at_once,
            self.operator_is_here,
        )

    def _make_video(self, network: Network, codecs: Codecs, helper_logs: Path) -> Senders:
        return Uplink(
            self.config,
            network,
            self._clock,
            self._log,
            self._quality.captured,
            self._show,
            helper_logs,
            self._on_packets,
            self._on_worker_failure,
            codecs=codecs,
            faces=self.signals.faces,
        )

    def _make_controller(self) -> Controller:
        return self._devices.make_controller(self.note)

    def _hand(self) -> str:
        """What drives the arm now, of `HANDS`."""
        return hand_of(self.config)

    def _listeners(self) -> tuple[Listener, ...]:
        """More of them."""
        return ()

    def _show_note(self, text: str) -> None:
        self.sentences.note(text)

    def _connect_devices(self, helper_logs: Path) -> ConnectedDevices:
        guard = Guarding(
            self._devices.arm_config(), self.config.limits, helper_logs, self.signals, self.note
        )
        self._stack.callback(guard.close)
        guard.start()
        arm = self._devices.make_arm()
        boundary = session_boundary(self.config.arm, self.config.limits)
        if self._dry_run:
            arm = DryRunArm(arm, self.config.arm, self._clock, boundary)
            self.note("warning", "dry run: the arm does not move, its commands go to a model of it")
        self._stack.callback(arm.close)
        arm.connect()
        self._hurry(arm.realtime_thread_ids)
        gate = ArmGate(arm, boundary, self.note)
        self._arm, self._gate = arm, gate
        guard.wait_ready()
        self._helpers["guard"] = guard.process
        controller = self._make_controller()
        self.keyboard = keyboard_of(controller)
        self._stack.callback(controller.close)
        controller.start()
        self._hurry(controller.realtime_thread_ids)
        return ConnectedDevices(arm, gate, controller, self._devices.truth, guard)

    def _hurry(self, thread_ids: Mapping[str, int]) -> None:
        """Real-time priority, just below the control loop's, for what it waits for."""
        if priority := self.config.control.realtime_priority:
            for thread_id in thread_ids.values():
                use_fifo(priority - 1, thread_id)

    def _start_workers(self, connected: ConnectedDevices, cameras: ExitStack) -> None:
        engine = self._engine
        self._run("arm-gate", connected.gate.run, GATE_TIMEOUT_S)
        self._run("policy", engine.policy.run)
        for camera in self._devices.make_cameras(self.note):
            camera.start()
            cameras.callback(camera.close)
            capture = Capture(camera, self._rates.through(self._video.push))
            self._run(f"capture-{camera.view}", capture.run)
        self._run("load", LoadMonitor(self._clock, self._helper_pids(), self._log.record).run)
        if connected.truth is not None:
            self._run("trial", engine.trial.run)

    def _show(self, shown: ShownFrame) -> None:
        """Where window, seeing operator and SSIM helper read; in a thread for each view."""
        self.screen.put(shown.view, shown.index, shown.shown_ns, shown.image)

    def _helper_pids(self) -> dict[str, int]:
        pids = {name: process.pid for name, process in self._helpers.items()}
        pids.update(relay=self._video.relay_pid, quality=self._quality.pid)
        pids.update(ros2=self._log.bridge_pid)
        return {name: pid for name, pid in pids.items() if pid is not None}

    def _run(
        self, name: str, body: Callable[[threading.Event], None], timeout_s: float = 2.0
    ) -> Worker:
        worker = Worker(name, body, self._on_worker_failure)
        self._stack.callback(worker.stop, timeout_s)
        worker.start()
        return worker

    def _control_thread(self, stop: threading.Event) -> None:
        scheduler = use_fifo(self.config.control.realtime_priority)
        if scheduler != "fifo":
            self.note("warning", f"control runs without real-time priority, {scheduler}")
        self._engine.begin(scheduler.split(":")[0])
        self._engine.control.run(stop)

    # --- while it runs --------------------------------------------------------------------------

    def poll(self) -> None:
        """Look after helpers, streams, frame rates and the time limit. From the main thread."""
        for name, process in self._helpers.items():
            if process.exit_code is not None:
                self.fail(f"the helper process {name} ended unasked; see {self.folder}/helpers")
        if failure := self._video.poll():
            self.fail(failure)
        self._rates.poll()
        self._end_if_due()

    def fail(self, sentence: str) -> None:
        """The job has failed: stop the arm, let the session end with exit code 1."""
        self.signals.fail()
        if not self.failure:
            self.failure = sentence
            self.note("error", sentence)
        self.end(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self._log.note(level, text)

    def fact(self, name: str, value: str) -> None:
        """Keep in the log what was learned; a later value of the same name counts."""
        self._log.fact(name, value)

    def state(self) -> SessionState:
        """What the console shows at this moment."""
        state = self._state_at(self._clock.now_ns())
        live_ssim = self._quality.recent_live(state.primary_view, state.now_ns)
        views = {view: self._with_latency(view, one) for view, one in state.views.items()}
        return msgspec.structs.replace(state, live_ssim=live_ssim, views=views)

    def _state_at(self, now_ns: int) -> SessionState:
        """What this side knows without its screen; from any thread, and quickly."""
        video, given_fps = self._video, self._rates.given_fps
        return self._board.state(
            now_ns, self.elapsed_s(), video, video.capacity, given_fps, self._hand()
        )

    def _with_latency(self, view: str, state: ViewState) -> ViewState:
        shown = self._video.shown(view)
        if shown is None:
            return state
        latency_ms = (shown.shown_ns - shown.capture_ns) / NS_PER_MS
        return msgspec.structs.replace(state, latency_ms=latency_ms)

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
            control.join(CONTROL_TIMEOUT_S)
        gate.stop()

    def close(self) -> None:
        """Stop the arm, then everything else in the reverse order of its start.

        What fails on the way is kept in `failure`, unless there is one already.
        """
        try:
            self.stop_arm()
            self._log.record(self._engine.trial.outcome(self._end_reason))
        finally:
            self._unwind()

    def _unwind(self) -> None:
        try:
            self._stack.close()
        except (TamsError, OSError) as failure:
            self.failure = self.failure or str(failure)

    def _await_stop(self, arm: Arm, control: Worker) -> None:
        """Wait, but not for long, until the log has the arm's report that it has stopped."""
        deadline_ns = self._clock.now_ns() + STOP_TIMEOUT_NS
        while control.alive and self._clock.now_ns() < deadline_ns:
            state = arm.state()
            if state is not None and state.activity is Activity.STOPPED:
                deadline_ns = min(deadline_ns, state.received_ns + LOGGED_AFTER_NS)
            self._clock.sleep_until_ns(self._clock.now_ns() + STOP_POLL_NS)

    # --- called by the parts --------------------------------------------------------------------

    def _trial_is_limited(self) -> bool:
        """A person who tries the rig takes their time."""
        return self.config.operator_is_simulated

    def _on_worker_failure(self, name: str, failure: BaseException) -> None:
        sentence = str(failure) if isinstance(failure, TamsError) else f"{name}: {failure!r}"
        self.fail(sentence)

    def _on_packets(self, packets: list[PacketRecord]) -> None:
        self._board.packets(packets)
        self._log.packets(packets)

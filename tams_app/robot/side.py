"""The robot's side of a live session: arm, cameras, guard, engine and streams, and their order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from hw.arm import Arm
from hw.boundary import session_boundary
from tams_app.config import Config, LinkConfig
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Activity, Frame, PacketRecord, Placed, SessionState
from tams_app.robot import build
from tams_app.robot.arm_gate import GATE_TIMEOUT_S, ArmGate
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.dry_run import DryRunArm
from tams_app.robot.engine import Engine
from tams_app.robot.episode_keeper import EpisodeKeeper
from tams_app.robot.frame_rates import FrameRates
from tams_app.robot.guarding import Guarding
from tams_app.robot.listener import Listener
from tams_app.robot.operator import StreamedOperator
from tams_app.robot.senders import Capture, Senders
from tams_app.robot.session_records import SessionRecords
from tams_app.robot.status import StatusBoard
from tams_app.runtime.clock import Clock
from tams_app.runtime.ending import Ending
from tams_app.runtime.parts import Parts
from tams_app.runtime.worker import Worker
from tams_app.task.episodes import Episodes
from tams_app.task.judge import PLACED
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import Codecs
from tams_app.video.live.networks import read_trace, resolve_network
from tams_app.video.live.traces import described

STOP_TIMEOUT_NS = 300 * NS_PER_MS
STOP_POLL_NS = 10 * NS_PER_MS
LOGGED_AFTER_NS = 30 * NS_PER_MS  # a few ticks
CONTROL_TIMEOUT_S = 0.1


class RobotSide:
    """`launch`, `stream`, `wait_ready`, `connect`, `begin`, in this order; then `poll`.

    In the end `stop_arm`, then `finish`.
    What it starts is one of `parts`, which end it.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        parts: Parts,
        log: SessionRecords,
        signals: Signals,
        ending: Ending,
        arm_at_once: bool = False,
        dry_run: bool = False,
    ) -> None:
        """`ending`: of the session.

        `arm_at_once`: the arming needs no confirmation. `dry_run`: everything but motion, the arm's
        commands go to a model of it.
        """
        self._config, self._clock, self._parts, self._log = config, clock, parts, log
        self._signals, self._ending = signals, ending
        self._arm_at_once, self._dry_run = arm_at_once, dry_run
        self._arm: Arm | None = None
        self._gate: ArmGate | None = None
        self._control: Worker | None = None
        weights = WeightMatrix(config.policy.weights.matrix)
        self._board = StatusBoard(config.video.views, weights, config.video.fps, log.newest)
        keeping = config.recording
        self._episodes: EpisodeKeeper | None = None
        if keeping.episodes:
            wanted = Episodes(keeping.countdown_s, keeping.episode_limit_s, keeping.episode_count)
            self._episodes = EpisodeKeeper(wanted, signals, log, self._put_back, ending.end)

    # --- start ----------------------------------------------------------------------------------

    def launch(self) -> str:
        """Begin to start the devices; the name of the rig's memory, "" without the rig."""
        config = self._config
        self._devices = build.devices(config, self._clock, self._parts.logs)
        self._parts.stack.callback(self._devices.close)
        self._devices.start()
        return self._devices.memory_name

    def stream(
        self,
        operator: StreamedOperator,
        codecs: Codecs,
        captured: Callable[[Frame], None] = lambda _frame: None,
        link: LinkConfig | None = None,
    ) -> None:
        """Let the video flow to `operator` as soon as there are frames, which `captured` gets too.

        `link`: the real network on the way, None: there is none.
        """
        config, parts = self._config, self._parts
        self._operator = operator
        network = resolve_network(config, config.network)
        if network.trace is not None:
            text, is_plausible = described(read_trace(Path(network.trace)))
            level = "info" if is_plausible else "warning"
            self._log.note(level, f"the trace of network {config.network}: {text}")
        self._video = Senders(
            config,
            network,
            self._clock,
            self._log,
            captured,
            operator,
            parts.logs,
            self._on_packets,
            parts.on_failure,
            codecs=codecs,
            link=link,
        )
        parts.stack.callback(self._video.close)
        self._video.start()
        self._rates = FrameRates(config.video.views, self._clock, self._log.record)

    def wait_ready(self) -> None:
        """Wait until arm and cameras can be reached; TamsError says what is not."""
        self._cameras = self._parts.stack.enter_context(ExitStack())  # end after arm and operator
        self._devices.wait_ready()
        for name, process in self._devices.helpers.items():
            self._parts.watch(name, process)

    def connect(self, listeners: Sequence[Listener] = ()) -> None:
        """Connect arm, guard and controller, and build what works with them.

        `listeners` of the loops, besides those of this side.
        """
        devices, operator, log = self._connected(), self._operator, self._log
        self._engine = Engine(
            self._config,
            self._clock,
            devices,
            operator,
            self._video,
            log,
            self._signals,
            lambda: self._ending.end("the trial is over"),
            (self._board, *filter(None, (self._episodes,)), *listeners),
            self._arm_at_once,
            self._on_placed,
        )
        self._parts.stack.callback(self._engine.finish)
        self._start_workers(devices)

    def begin(self) -> None:
        """Start the control loop, last of all."""
        self._control = self._parts.run("control", self._control_thread)

    def _connected(self) -> ConnectedDevices:
        config, parts, log = self._config, self._parts, self._log
        guard = Guarding(
            self._devices.arm_config(), config.limits, parts.logs, self._signals, log.note
        )
        arm = self._devices.make_arm()
        boundary = session_boundary(config.arm, config.limits)
        if self._dry_run:
            arm = DryRunArm(arm, config.arm, self._clock, boundary)
            log.note("warning", "dry run: the arm does not move, its commands go to a model of it")
        guard.join(arm, parts.stack, arm.connect)
        parts.hurry(arm.realtime_thread_ids)
        self._arm, self._gate = arm, ArmGate(arm, boundary, log.note)
        parts.watch("guard", guard.process)
        return ConnectedDevices(arm, self._gate, self._devices.truth, guard)

    def _start_workers(self, devices: ConnectedDevices) -> None:
        parts, engine = self._parts, self._engine
        parts.run("arm-gate", devices.gate.run, GATE_TIMEOUT_S)
        parts.run("policy", engine.policy.run)
        for camera in self._devices.make_cameras(self._log.note):
            camera.start()
            self._cameras.callback(camera.close)
            capture = Capture(camera, self._rates.through(self._video.push))
            parts.run(f"capture-{camera.view}", capture.run)
        if devices.truth is not None:
            parts.run("trial", engine.trial.run)

    def _control_thread(self, stop: threading.Event) -> None:
        scheduler = self._parts.use_control_priority()
        if scheduler != "fifo":
            self._log.note("warning", f"control runs without real-time priority, {scheduler}")
        self._engine.begin(scheduler.split(":")[0])
        self._engine.control.run(stop)

    # --- while it runs --------------------------------------------------------------------------

    @property
    def station(self) -> None:
        """Nothing is shown on this side."""

    @property
    def pids(self) -> dict[str, int]:
        """Of helper processes whose end shows elsewhere."""
        relay = self._video.relay_pid
        return {} if relay is None else {"relay": relay}

    def poll(self) -> str:
        """Record the frame rates; the first failure of any stream, "" while all work."""
        self._rates.poll()
        return self._video.poll() or self._operator.poll()

    def state(self) -> SessionState:
        """The session as this side knows it now."""
        return self.state_at(self._clock.now_ns())

    def state_at(self, now_ns: int) -> SessionState:
        """The session as this side knows it, from any thread, and quickly."""
        operator = self._operator
        return self._board.state(
            now_ns,
            self._ending.elapsed_s(),
            operator,
            operator.hand,
            None if self._episodes is None else self._episodes.state,
            self._video.latency,
        )

    # --- end ------------------------------------------------------------------------------------

    def stop_arm(self, failed: bool) -> None:
        """Stop the arm: the first thing when a session ends; may be called twice.

        The control loop ends before, or it would take our stop for a fault; if it hangs, the stop
        is sent all the same.
        """
        arm, gate, control = self._arm, self._gate, self._control
        if arm is None or gate is None:
            return
        if control is not None:
            if failed:
                self._await_stop(arm, control)  # so that the log shows how the arm stopped
            control.request_stop()
            control.join(CONTROL_TIMEOUT_S)
        gate.stop()

    def finish(self, reason: str, failed: bool) -> None:
        """The arm has stopped: record the verdict, notify the operator why the session is over."""
        if self._episodes is not None:
            self._episodes.finish()
        try:
            self._log.record(self._engine.trial.outcome(reason))
        finally:
            self._operator.end(reason, failed)

    def _await_stop(self, arm: Arm, control: Worker) -> None:
        """Wait, but not for long, until the log has the arm's report that it has stopped."""
        deadline_ns = self._clock.now_ns() + STOP_TIMEOUT_NS
        while control.alive and self._clock.now_ns() < deadline_ns:
            state = arm.state()
            if state is not None and state.activity is Activity.STOPPED:
                deadline_ns = min(deadline_ns, state.received_ns + LOGGED_AFTER_NS)
            self._clock.sleep_until_ns(self._clock.now_ns() + STOP_POLL_NS)

    def _put_back(self) -> None:
        """The scene of the next episode, in the control thread."""
        if self._operator.is_simulated:  # places the block once, and knows of no episodes
            return
        self._devices.put_back()
        self._engine.trial.again()
        self._log.record(Placed(self._clock.now_ns(), placed=False))

    def _on_placed(self) -> None:
        self._log.record(Placed(self._clock.now_ns(), placed=True))
        then = "" if self._operator.is_simulated else ": go on, or press q to end the session"
        self._log.note("info", PLACED + then)

    def _on_packets(self, packets: list[PacketRecord]) -> None:
        self._board.packets(packets)
        self._log.packets(packets)

"""The robot's side of a live session: arm, cameras, guard, engine and streams, and their order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from hw.arms import session_boundary
from tams_app.config import Config, LinkConfig
from tams_app.recording.journal import Journal
from tams_app.records import Activity, Frame, PacketRecord, Placed, Record, SessionState, Tick
from tams_app.robot import build
from tams_app.robot.arm_gate import GATE_TIMEOUT_S, ArmGate
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices, Devices
from tams_app.robot.dry_run import DryRunArm
from tams_app.robot.engine import Engine
from tams_app.robot.episode_keeper import EpisodeKeeper
from tams_app.robot.frame_rates import FrameRates
from tams_app.robot.guarding import Guarding
from tams_app.robot.listener import Listener
from tams_app.robot.operator import StreamedOperator
from tams_app.robot.senders import Capture, Senders
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


class Ground:
    """What all parts of the robot's side stand on; `ending` is the session's."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        parts: Parts,
        log: Journal,
        signals: Signals,
        ending: Ending,
    ) -> None:
        self.config, self.clock, self.parts = config, clock, parts
        self.log, self.signals, self.ending = log, signals, ending
        self.board = StatusBoard(config, log.newest)


def start_devices(ground: Ground) -> Devices:
    """Begin to start the devices, which the session's parts end; `wait_ready` before their use."""
    devices = build.devices(ground.config, ground.clock, ground.parts.logs)
    ground.parts.stack.callback(devices.close)
    devices.start()
    return devices


def start_video(
    ground: Ground,
    operator: StreamedOperator,
    codecs: Codecs,
    captured: Callable[[Frame], None] = lambda _frame: None,
    link: LinkConfig | None = None,
) -> Senders:
    """Let the video flow to `operator` as soon as there are frames, which `captured` gets too.

    `link`: the real network on the way, None: there is none.
    """
    config, parts, log = ground.config, ground.parts, ground.log
    network = resolve_network(config, config.network)
    if network.trace is not None:
        text, is_plausible = described(read_trace(Path(network.trace)))
        level = "info" if is_plausible else "warning"
        log.note(level, f"the trace of network {config.network}: {text}")

    def on_packets(packets: list[PacketRecord]) -> None:
        ground.board.packets(packets)
        log.packets(packets)

    video = Senders(
        config,
        network,
        ground.clock,
        log,
        captured,
        operator,
        parts.logs,
        on_packets,
        parts.on_failure,
        codecs=codecs,
        link=link,
    )
    parts.stack.callback(video.close)
    video.start()
    return video


class RobotSide(Listener):
    """Arm, guard, engine and cameras, connected and at work; the control loop from `begin` on.

    In the end `stop_arm`, then `finish`. What it starts is one of the session's parts, which end
    it.
    """

    def __init__(
        self,
        ground: Ground,
        devices: Devices,
        video: Senders,
        operator: StreamedOperator,
        listeners: Sequence[Listener] = (),
        arm_at_once: bool = False,
        dry_run: bool = False,
    ) -> None:
        """Connect arm, guard and controller, and build what works with them; TamsError if it fails.

        `devices` are ready. `listeners` of the loops, besides those of this side. `arm_at_once`:
        the arming needs no confirmation. `dry_run`: everything but motion, the arm's commands go to
        a model of it.
        """
        config, log, parts = ground.config, ground.log, ground.parts
        self._ground, self._devices = ground, devices
        self._video, self._operator = video, operator
        self._control: Worker | None = None
        self._rates = FrameRates(config.video.views, ground.clock, log.record)
        keeping, self._episodes = config.recording, None
        if keeping.episodes:
            wanted = Episodes(keeping.countdown_s, keeping.episode_limit_s, keeping.episode_count)
            self._episodes = EpisodeKeeper(
                wanted, ground.signals, log, self._put_back, ground.ending.end
            )
        self._cameras = parts.stack.enter_context(ExitStack())  # end after the arm
        for name, process in devices.helpers.items():
            parts.watch(name, process)
        connected = self._connect(dry_run)
        self._arm, self._gate = connected.arm, connected.gate
        self._engine = Engine(
            config,
            ground.clock,
            connected,
            operator,
            video,
            log,
            ground.signals,
            lambda: ground.ending.end("the trial is over"),
            (ground.board, *filter(None, (self._episodes,)), *listeners, self),
            arm_at_once,
            self._on_placed,
        )
        parts.stack.callback(self._engine.finish)
        self._start_workers(connected)

    def begin(self) -> None:
        """Start the control loop, last of all."""
        self._control = self._ground.parts.run("control", self._control_thread)

    def receive(self, record: Record) -> None:
        """After a tick, send the operator the state if it is time to."""
        if isinstance(record, Tick) and self._operator.wants_state(record.started_ns):
            self._operator.show(self.state())

    def _connect(self, dry_run: bool) -> ConnectedDevices:
        ground, parts, log = self._ground, self._ground.parts, self._ground.log
        config, devices = ground.config, self._devices
        guard = Guarding(devices.arm_config(), config.limits, parts.logs, ground.signals, log.note)
        arm = devices.make_arm()
        boundary = session_boundary(config.arm, config.limits)
        if dry_run:
            arm = DryRunArm(arm, config.arm, ground.clock, boundary)
            log.note("warning", "dry run: the arm does not move, its commands go to a model of it")
        guard.join(arm, parts.stack, arm.connect)
        parts.hurry(arm.realtime_thread_ids)
        gate = ArmGate(arm, boundary, log.note)
        parts.watch("guard", guard.process)
        return ConnectedDevices(arm, gate, devices.truth, guard)

    def _start_workers(self, devices: ConnectedDevices) -> None:
        parts, engine, log = self._ground.parts, self._engine, self._ground.log
        parts.run("arm-gate", devices.gate.run, GATE_TIMEOUT_S)
        parts.run("policy", engine.policy.run)
        for camera in self._devices.make_cameras(log.note):
            camera.start()
            self._cameras.callback(camera.close)
            capture = Capture(camera, self._rates.through(self._video.push))
            parts.run(f"capture-{camera.view}", capture.run)
        if devices.truth is not None:
            parts.run("trial", engine.trial.run)

    def _control_thread(self, stop: threading.Event) -> None:
        scheduler = self._ground.parts.use_control_priority()
        if scheduler != "fifo":
            self._ground.log.note(
                "warning", f"control runs without real-time priority, {scheduler}"
            )
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
        """The session as this side knows it now, from any thread, and quickly."""
        operator = self._operator
        return self._ground.board.state(
            self._ground.clock.now_ns(),
            self._ground.ending.elapsed_s(),
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
        if (control := self._control) is not None:
            if failed:
                self._await_stop(control)  # so that the log shows how the arm stopped
            control.request_stop()
            control.join(CONTROL_TIMEOUT_S)
        self._gate.stop()

    def finish(self, reason: str, failed: bool) -> None:
        """The arm has stopped: record the verdict, notify the operator why the session is over."""
        if self._episodes is not None:
            self._episodes.finish()
        try:
            self._ground.log.record(self._engine.trial.outcome(reason))
        finally:
            self._operator.end(reason, failed)

    def _await_stop(self, control: Worker) -> None:
        """Wait, but not for long, until the log has the arm's report that it has stopped."""
        deadline_ns = self._ground.clock.now_ns() + STOP_TIMEOUT_NS
        while control.alive and self._ground.clock.now_ns() < deadline_ns:
            state = self._arm.state()
            if state is not None and state.activity is Activity.STOPPED:
                deadline_ns = min(deadline_ns, state.received_ns + LOGGED_AFTER_NS)
            self._ground.clock.sleep_until_ns(self._ground.clock.now_ns() + STOP_POLL_NS)

    def _put_back(self) -> None:
        """The scene of the next episode, in the control thread."""
        if self._operator.is_simulated:  # places the block once, and knows of no episodes
            return
        self._devices.put_back()
        self._engine.trial.again()
        if self._devices.truth is not None:  # else nothing was put back, and no judge sees it
            self._record_placed(False)

    def _on_placed(self) -> None:
        self._record_placed(True)
        then = "" if self._operator.is_simulated else ": go on, or press q to end the session"
        self._ground.log.note("info", PLACED + then)

    def _record_placed(self, placed: bool) -> None:
        record = Placed(self._ground.clock.now_ns(), placed)
        self._ground.log.record(record)
        self._operator.receive(record)

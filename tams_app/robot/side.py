"""The robot's side of a live session: arm, cameras, guard, engine and streams, and their order."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from hw.arms import session_boundary
from tams_app.config import LinkConfig
from tams_app.records import Activity, Placed, Record, SessionState, Tick
from tams_app.robot import build
from tams_app.robot.arm_gate import GATE_TIMEOUT_S, ArmGate
from tams_app.robot.devices import ConnectedDevices, Devices
from tams_app.robot.engine import Engine
from tams_app.robot.ground import LiveGround
from tams_app.robot.guarding import Guarding
from tams_app.robot.listener import Listener
from tams_app.robot.observers import TRIAL_RATE_HZ
from tams_app.robot.operator import Operator
from tams_app.robot.senders import Capture, FrameRates, Senders
from tams_app.robot.status import StatusBoard
from tams_app.robot.video import TakeFrame
from tams_app.runtime.clock import FixedRate
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS
from tams_app.video.live.networks import described, read_trace, resolve_network

if TYPE_CHECKING:  # `run` needs nothing of the link
    from tams_app.robot.linked_operator import LinkedOperator

STOP_TIMEOUT_NS = 300 * NS_PER_MS
STOP_POLL_NS = 10 * NS_PER_MS
LOGGED_AFTER_NS = 30 * NS_PER_MS  # a few ticks
CONTROL_TIMEOUT_S = 0.1


def start_devices(ground: LiveGround) -> Devices:
    """Start the devices without waiting (`wait_ready` before use); `Parts.stack` closes them."""
    devices = build.devices(ground.config, ground.clock, ground.parts.logs)
    ground.parts.stack.callback(devices.close)
    devices.start()
    return devices


def bind_video(
    ground: LiveGround,
    board: StatusBoard,
    captured: TakeFrame | None = None,
    link: LinkConfig | None = None,
) -> Senders:
    """The video, ready for frames, which `captured` gets too.

    `link`: of the real network on the way, if there is one.
    """
    config = ground.config
    network = resolve_network(config, config.network)
    if network.trace is not None:
        text, is_plausible = described(read_trace(Path(network.trace)))
        level = "info" if is_plausible else "warning"
        ground.log.note(level, f"the trace of network {config.network}: {text}")
    return Senders(ground, network, board, captured, link=link)


class RobotSide(Listener):
    """Arm, guard, engine and cameras, connected and at work; the control loop from `begin` on.

    To end: `stop_arm`, then `finish`; `Parts.stack` closes what it started.
    """

    def __init__(
        self,
        ground: LiveGround,
        board: StatusBoard,
        devices: Devices,
        video: Senders,
        operator: Operator,
        listeners: Sequence[Listener] = (),
        link: LinkedOperator | None = None,
    ) -> None:
        """Connect arm, guard and controller, and build what works with them; TamsError if it fails.

        `devices` are ready. `listeners` of the loops, besides those of this side. `link`: the
        operator again, if over a link: they are sent the state and the end.
        """
        config, log, parts = ground.config, ground.log, ground.parts
        self._ground, self._board = ground, board
        self._devices, self._video, self._operator, self._link = devices, video, operator, link
        self._control = Worker("control", self._control_thread, parts.on_failure)
        self._rates = FrameRates(config.video.views, ground.clock, log)
        keeping, self._episodes = config.recording, None
        if keeping.episodes:
            from tams_app.robot.episode_keeper import EpisodeKeeper
            from tams_app.task.episodes import Episodes

            wanted = Episodes(keeping.countdown_s, keeping.episode_limit_s, keeping.episode_count)
            self._episodes = EpisodeKeeper(wanted, ground.signals, log)
        self._cameras = parts.stack.enter_context(ExitStack())  # end after the arm
        for name, process in devices.helpers.items():
            parts.watch(name, process)
        connected = self._connect()
        self._arm, self._gate = connected.arm, connected.gate
        all_of_them = (board, *listeners, self)
        self._engine = Engine(ground, connected, operator, video, all_of_them, ground.arm_at_once)
        parts.stack.callback(self._engine.finish)
        self._start_workers(connected)

    def begin(self) -> None:
        """Start the control loop, last of all."""
        self._ground.parts.start(self._control)

    def receive(self, record: Record) -> None:
        """After a tick, see to the episodes, and send the operator the state if it is time to."""
        if not isinstance(record, Tick):
            return
        if self._episodes is not None:
            due = self._episodes.step(record)
            if due.scene:
                self._put_back()
            if due.end:
                self._ground.ending.end("all episodes are kept")
        if self._link is not None and self._link.wants_state(record.started_ns):
            self._link.show(self.state())

    def _connect(self) -> ConnectedDevices:
        ground, parts, log = self._ground, self._ground.parts, self._ground.log
        config, devices = ground.config, self._devices
        guard = Guarding(devices.arm_config(), config.limits, parts.logs, ground.signals, log.note)
        arm = devices.make_arm()
        boundary = session_boundary(config.arm, config.limits)
        if ground.dry_run:
            from tams_app.robot.dry_run import DryRunArm

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
            capture = Capture(camera, self._rates, self._video)
            parts.run(f"capture-{camera.view}", capture.run)
        if devices.truth is not None:
            parts.run("trial", self._judge)

    def _control_thread(self, stop: threading.Event) -> None:
        scheduler = self._ground.parts.use_control_priority()
        if scheduler != "fifo":
            self._ground.log.note(
                "warning", f"control runs without real-time priority, {scheduler}"
            )
        self._engine.begin(scheduler.split(":")[0])
        self._engine.control.run(stop)

    def _judge(self, stop: threading.Event) -> None:
        """Look at the trial until it is over."""
        rate = FixedRate(self._ground.clock, TRIAL_RATE_HZ)
        while not stop.is_set():
            rate.wait()
            found = self._engine.look()
            if found.placed:
                self._on_placed()
            if found.over:
                self._ground.ending.end("the trial is over")
                return

    # --- while it runs --------------------------------------------------------------------------

    def poll(self) -> str:
        """Record the frame rates; the first failure of any stream, "" while all work."""
        self._rates.poll()
        return self._video.poll()

    def state(self) -> SessionState:
        """The session as this side knows it now, from any thread, and quickly."""
        operator = self._operator
        return self._board.state(
            self._ground.clock.now_ns(),
            self._ground.ending.elapsed_s(),
            operator,
            operator.hand,
            None if self._episodes is None else self._episodes.state,
            self._video.latency,
        )

    # --- end ------------------------------------------------------------------------------------

    def stop_arm(self, failed: bool) -> None:
        """End the control loop, or it would take our stop for a fault, then stop the arm.

        If it hangs, the stop is sent all the same. `failed`: `Outset.fail` has stopped the arm, and
        the log gets a moment to show how.
        """
        if failed:
            self._await_stop()
        self._control.request_stop()
        self._control.join(CONTROL_TIMEOUT_S)
        self._gate.stop()

    def finish(self, reason: str, failed: bool) -> None:
        """The stop is sent: record the verdict, tell the operator why the session is over."""
        if self._episodes is not None:
            self._episodes.finish()
        try:
            self._ground.log.record(self._engine.outcome(reason))
        finally:
            if self._link is not None:
                self._link.end(reason, failed)

    def _await_stop(self) -> None:
        """Wait, but not for long, until the log has the arm's report that it has stopped."""
        deadline_ns = self._ground.clock.now_ns() + STOP_TIMEOUT_NS
        while self._control.alive and self._ground.clock.now_ns() < deadline_ns:
            state = self._arm.state()
            if state is not None and state.activity is Activity.STOPPED:
                deadline_ns = min(deadline_ns, state.received_ns + LOGGED_AFTER_NS)
            self._ground.clock.sleep_until_ns(self._ground.clock.now_ns() + STOP_POLL_NS)

    def _put_back(self) -> None:
        """The scene of the next episode, in the control thread."""
        if self._operator.is_simulated:  # places the block once, and knows of no episodes
            return
        self._devices.put_back()
        if self._engine.trial is not None:  # else nothing was put back, and no judge sees it
            self._engine.trial.again()
            self._record_placed(False)

    def _on_placed(self) -> None:
        from tams_app.task.judge import PLACED  # the judge has found it

        self._record_placed(True)
        then = "" if self._operator.is_simulated else ": go on, or press q to end the session"
        self._ground.log.note("info", PLACED + then)

    def _record_placed(self, placed: bool) -> None:
        record = Placed(self._ground.clock.now_ns(), placed)
        self._ground.log.record(record)
        self._operator.receive(record)

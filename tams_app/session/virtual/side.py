"""The robot's side in virtual time: rig, streams and engine, and what of them is due when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial

from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import Frame, Outcome, PhaseChange, Record
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.engine import Engine
from tams_app.robot.listener import Listener
from tams_app.robot.observers import TRIAL_RATE_HZ
from tams_app.runtime.clock import Clock
from tams_app.session.task_place import task_regions
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.rig import VirtualCameras, VirtualRobot
from tams_app.session.virtual.video import TrialVideo
from tams_app.units import NS_PER_S
from tams_app.video.virtual.event_queue import EventQueue


class VirtualRobotSide(Listener):
    """One engine and the events that move it. `begin` it, let time pass, `stop` it, `close` it."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        events: EventQueue,
        log: Journal,
        operator: VirtualOperator,
        captured: Callable[[Frame], None],
        ended: Callable[[str], None],
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`captured` gets each frame before it is sent. `ended` gets why the trial is over.

        `listeners` of the loops, besides those of a session.
        """
        self._events, self._operator = events, operator
        self._rate_hz = config.control.rate_hz
        regions = task_regions(config)
        with ExitStack() as stack:
            self._robot = robot = VirtualRobot(config, clock, log.note)
            self._video = TrialVideo(config, clock, log, captured, operator.see)
            stack.callback(self._video.close)
            self._cameras = VirtualCameras(config, robot, events, regions.through(self._video.push))
            stack.callback(self._cameras.close)
            robot.arm.connect()
            self._engine = Engine(
                config,
                clock,
                ConnectedDevices(robot.arm, robot.gate, robot.truth),
                operator,
                self._video,
                log,
                Signals(),
                lambda: ended("the trial is over"),
                (self, regions, *listeners),
            )
            self._stack = stack.pop_all()

    @property
    def started(self) -> bool:
        """The operator has engaged the arm."""
        return self._engine.trial.started

    def begin(self, now_ns: int) -> None:
        """From now on each part is due at its rate."""
        events, trial = self._events, self._engine.trial
        self._engine.begin("virtual")
        self._cameras.start(now_ns)
        events.post(now_ns, self._step_policy)
        repeat(events, now_ns, self._rate_hz, self._tick)
        repeat(events, now_ns, TRIAL_RATE_HZ, lambda _due_ns: trial.look())

    def advance_to(self, now_ns: int) -> None:
        """Let everything happen to the video that is due up to `now_ns`."""
        self._video.advance_to(now_ns)

    def stop(self) -> None:
        """Stop the arm for good."""
        self._robot.stop()
        self._engine.finish()

    def outcome(self, reason: str) -> Outcome:
        """The verdict; `reason` says why the trial ended."""
        return self._engine.trial.outcome(reason)

    def close(self) -> None:
        """Give everything back; may be called twice."""
        self._stack.close()

    def receive(self, record: Record) -> None:
        """Where the policy loop has been woken, let it step."""
        if isinstance(record, PhaseChange):
            self._events.post(record.t_ns, self._step_policy)

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


def repeat(
    events: EventQueue, now_ns: int, rate_hz: float, action: Callable[[int], object]
) -> None:
    """Do `action` with its due time `rate_hz` times a second, first one period after `now_ns`."""
    period_ns = round(NS_PER_S / rate_hz)

    def again(due_ns: int) -> None:
        events.post(due_ns + period_ns, partial(again, due_ns + period_ns))
        action(due_ns)

    events.post(now_ns + period_ns, partial(again, now_ns + period_ns))

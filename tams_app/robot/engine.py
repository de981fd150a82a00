"""The parts between controller, arm and encoders, built once for both clocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from hw.arms import arm_kind
from tams_app.config import Config
from tams_app.recording.journal import Journal
from tams_app.records import Phase, PhaseChange, Record
from tams_app.robot import build
from tams_app.robot.control import Signals
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.listener import Listener
from tams_app.robot.observers import ArmingNotes, HeatWatch, StopWatch, TrialObserver
from tams_app.robot.operator import Operator
from tams_app.robot.policy_loop import PolicyLoop
from tams_app.robot.video import Video
from tams_app.runtime.clock import Clock
from tams_app.teleop.hands import HAND_FACT

VIDEO_DELAY_FACT = "video_delay_ns"


class Engine:
    """Control, policy, observers and judge of one session; it makes no thread and no file.

    Its owner runs the loops: `side.RobotSide` gives each a thread, a `VirtualRobotSide` of
    `tams_app.session.virtual` events. A phase change goes from the control loop through the
    listeners straight to the policy loop, which sets the encoders' targets.
    """

    def __init__(
        self,
        config: Config,
        clock: Clock,
        devices: ConnectedDevices,
        operator: Operator,
        video: Video,
        log: Journal,
        signals: Signals,
        ended: Callable[[], None],
        listeners: Sequence[Listener] = (),
        arm_at_once: bool = False,
        placed: Callable[[], None] = lambda: None,
    ) -> None:
        """`ended` is called when the trial is over; `listeners` get everything after the others,
        and `operator` last. `placed`: see `TrialObserver`.
        """
        listeners = (*listeners, operator)
        self._operator = operator
        self._clock = clock
        self._log = log
        self._video = video
        self._stops = StopWatch()
        self.trial = TrialObserver(
            config.trial,
            clock,
            devices.arm,
            devices.truth,
            log.record,
            ended,
            lambda: operator.is_simulated,  # a person takes their time
            placed,
        )
        recorded = RecordedSteps(log)
        self.policy = PolicyLoop(config, clock, video, log, (recorded, *listeners))
        arming = ArmingNotes(signals, lambda: operator.hand, arm_at_once)
        heat = HeatWatch(arm_kind(config.arm.model).limits.hot_motor_c)
        guard = () if devices.guard is None else (devices.guard,)
        self.control = build.control_loop(
            config,
            clock,
            operator.take_controller(),
            devices.arm,
            devices.gate,
            operator,
            video.delay_ns,
            signals,
            # the guard first: its heartbeat before all else, armed and disarmed before any report
            (*guard, self.trial, recorded, self.policy, *listeners),
            (arming, heat, self._stops),
        )

    def begin(self, scheduler: str) -> None:
        """Log the start; `scheduler` says what runs the control loop."""
        self._log.fact("scheduler", scheduler)
        self._log.fact(HAND_FACT, self._operator.hand)
        self._log.fact("encoder", self._video.codecs.encoder.element)
        self._log.fact("decoder", self._video.codecs.decoder.element)
        self._log.fact(VIDEO_DELAY_FACT, str(self._video.delay_ns))
        self._log.record(PhaseChange(self._clock.now_ns(), Phase.REACH, "start"))

    def finish(self) -> None:
        """The control loop has ended: log a stop whose end was not seen."""
        for stop in self._stops.finish():
            self._log.record(stop)


class RecordedSteps(Listener):
    """Records what the loops make, at its place among their listeners."""

    def __init__(self, log: Journal) -> None:
        self._log = log

    def receive(self, record: Record) -> None:
        self._log.record(record)

"""The parts between controller, arm and encoders, for real and virtual time alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hw.arms import arm_kind
from tams_app.recording.journal import Journal
from tams_app.records import Outcome, Phase, PhaseChange, Record
from tams_app.robot import build
from tams_app.robot.control import LoopDevices
from tams_app.robot.devices import ConnectedDevices
from tams_app.robot.ground import Ground
from tams_app.robot.listener import Listener
from tams_app.robot.observers import ArmingNotes, HeatWatch, StopWatch, TrialLook
from tams_app.robot.operator import Operator
from tams_app.robot.policy_loop import PolicyLoop
from tams_app.robot.video import Video
from tams_app.teleop.hands import HAND_FACT
from tams_app.video.core.codecs import DECODER, ENCODER

if TYPE_CHECKING:  # of the rig
    from tams_app.robot.trial import TrialObserver

VIDEO_DELAY_FACT = "video_delay_ns"


class Engine:
    """Control, policy, observers and judge of one session; of its own it makes no thread or file.

    Its owner runs the loops: `side.RobotSide` gives each a thread, a `VirtualRobotSide` of
    `tams_app.session.virtual` events. A phase change goes from the control loop through the
    listeners straight to the policy loop, which sets the encoders' targets.
    """

    def __init__(
        self,
        ground: Ground,
        devices: ConnectedDevices,
        operator: Operator,
        video: Video,
        listeners: Sequence[Listener] = (),
        arm_at_once: bool = False,
    ) -> None:
        """Starts the controller. `listeners` come after the others, `operator` last."""
        config, log, signals = ground.config, ground.log, ground.signals
        listeners = (*listeners, operator)
        self._devices, self._operator, self._video = devices, operator, video
        self._clock, self._log = ground.clock, log
        self._stops = StopWatch()
        self.trial: TrialObserver | None = None  # without a known scene only a person can judge
        if devices.truth is not None:
            from tams_app.robot.trial import TrialObserver

            self.trial = TrialObserver(config.trial)
        recorded = RecordedSteps(log)
        self.policy = PolicyLoop(config, ground.clock, video, log, (recorded, *listeners))
        arming = ArmingNotes(signals, lambda: operator.hand, arm_at_once)
        heat = HeatWatch(arm_kind(config.arm.model).limits.hot_motor_c)
        guard = () if devices.guard is None else (devices.guard,)
        trial = () if self.trial is None else (self.trial,)
        controller = operator.take_controller()
        self.control = build.control_loop(
            config,
            ground.clock,
            LoopDevices(controller, devices.arm, devices.gate, operator),
            video.delay_ns,
            signals,
            # the guard first: it beats, arms and disarms before all else
            (*guard, *trial, recorded, self.policy, *listeners),
            (arming, heat, self._stops),
        )

    def begin(self, scheduler: str) -> None:
        """Log the start; `scheduler` says what runs the control loop."""
        self._log.fact("scheduler", scheduler)
        self._log.fact(HAND_FACT, self._operator.hand)
        self._log.fact("encoder", ENCODER)
        self._log.fact("decoder", DECODER)
        self._log.fact(VIDEO_DELAY_FACT, str(self._video.delay_ns))
        self._log.record(PhaseChange(self._clock.now_ns(), Phase.REACH, "start"))

    def look(self) -> TrialLook:
        """Record where things are and look at the trial; a person is given no time limit."""
        scene = None if self._devices.truth is None else self._devices.truth()
        if scene is None or self.trial is None:
            return TrialLook()
        self._log.record(scene)
        arm = self._devices.arm.state()
        return self.trial.look(self._clock.now_ns(), scene, arm, self._operator.is_simulated)

    def outcome(self, reason: str) -> Outcome:
        """The verdict; `reason` says why the session ended."""
        if self.trial is None:
            return Outcome(None, None, None, None, reason)
        return self.trial.outcome(reason)

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

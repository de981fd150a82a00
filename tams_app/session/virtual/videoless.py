"""One pick-and-place in virtual time, without video: what the control loop saw, and the truth.

All that moves is that of a study's trial (`tams_app.session.virtual`): scene, arm, control loop,
arming, rules and events. Left out is what makes such a trial dear, drawing, sending and looking at
images; so its participant has perfect eyes. Nothing here knows the thresholds that are sought.
"""

from __future__ import annotations

from collections.abc import Iterator

from hw.sim.operator.demo import SharpEyedHand
from tams_app.config import Config
from tams_app.records import Record, SceneTruth, Tick
from tams_app.robot import build
from tams_app.robot.control import ControlLoop, LoopDevices, Signals, SteadyVideo
from tams_app.robot.listener import Listener
from tams_app.robot.observers import TRIAL_RATE_HZ, ArmingNotes
from tams_app.robot.trial import TrialObserver
from tams_app.runtime.clock import VirtualClock
from tams_app.session.virtual.side import VirtualRobot, repeat
from tams_app.session.virtual.trial import ENGAGED_WITHIN_S, START_NS
from tams_app.teleop.hands import SIMULATED
from tams_app.units import NS_PER_S
from tams_app.video.virtual.stepped_clock import EventQueue

_YIELD_NS = NS_PER_S // 10


class VideolessTrial(Listener):
    """Scene `seed` with participant `seed`; `ticks` and `scene` are as in a log of it."""

    def __init__(self, config: Config, seed: int) -> None:
        config = config.model_copy(update={"seed": seed})
        build.check_ready_pose(config)
        self.ticks: list[Tick] = []
        self.scene: list[SceneTruth] = []
        self._rate_hz = config.control.rate_hz
        self._clock = VirtualClock(START_NS)
        self._events = EventQueue()
        self._ended = False
        self._robot = VirtualRobot(config, self._clock, _ignore)
        self._hand = SharpEyedHand(config, seed, self._robot.truth)
        self._trial = TrialObserver(config.trial)
        self._control = self._build_control(config)

    def perform(self) -> Iterator[float]:
        """Go on until placed, out of time or given up; yields the seconds gone by now and then."""
        self._begin()
        reported_ns = START_NS
        while not self._ended:
            due_ns = self._events.next_ns
            assert due_ns is not None, "the control loop always has something to do"
            while due_ns > reported_ns + _YIELD_NS:
                reported_ns += _YIELD_NS
                yield (reported_ns - START_NS) / NS_PER_S
            self._clock.sleep_until_ns(due_ns)
            self._events.do_next()
        self._robot.stop()

    def _build_control(self, config: Config) -> ControlLoop:
        robot, signals = self._robot, Signals()
        arming = ArmingNotes(signals, lambda: SIMULATED, arm_at_once=False)
        return build.control_loop(
            config,
            self._clock,
            LoopDevices(self._hand.controller, robot.arm, robot.gate, SteadyVideo()),
            0,
            signals,
            (self._trial, self),
            (arming,),
        )

    def receive(self, record: Record) -> None:
        if isinstance(record, Tick):
            self.ticks.append(record)

    def _begin(self) -> None:
        self._robot.arm.connect()
        self._hand.controller.start()
        repeat(self._events, START_NS, self._rate_hz, self._tick)
        repeat(self._events, START_NS, TRIAL_RATE_HZ, self._look)
        self._events.post(START_NS + round(ENGAGED_WITHIN_S * NS_PER_S), self._give_up)

    def _tick(self, due_ns: int) -> None:
        self._hand.prepare(due_ns)
        self._control.tick(due_ns)
        self._robot.gate.serve()

    def _look(self, _due_ns: int) -> None:
        scene = self._robot.truth()
        self.scene.append(scene)
        arm = self._robot.arm.state()
        self._ended |= self._trial.look(self._clock.now_ns(), scene, arm, is_limited=True).over

    def _give_up(self) -> None:
        self._ended |= not self._trial.started


def _ignore(_level: str, _text: str) -> None:
    """The notes of such a trial are not read."""

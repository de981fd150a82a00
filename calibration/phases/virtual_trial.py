"""One pick-and-place in virtual time, without pictures: what the control loop saw, and the truth.

Arm, controller, teleoperation and phase inference are the product's; a participant with perfect
eyes sits at the controls. Nothing here knows the thresholds that are sought.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hw.arm import ServoMode
from hw.boundary import session_boundary
from hw.sim.controller_model import ControllerModel
from hw.sim.efference import EfferenceCopy
from hw.sim.inprocess_arm import InProcessArm
from hw.sim.layout import draw_layout
from hw.sim.operator import Operator
from hw.sim.participant import ParticipantProfile
from hw.sim.perception import TruePerception
from hw.sim.virtual_controller import VirtualController
from hw.sim.world import World
from tams_app.clock import NS_PER_S, VirtualClock
from tams_app.config import Config
from tams_app.records import Outcome, SceneTruth, Tick
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.signals import Signals
from tams_app.session.supervisor import ArmSupervisor
from tams_app.session.trial_loop import RATE_HZ as SCENE_RATE_HZ
from tams_app.study.trial import TrialJudge
from tams_app.teleop.safety import ArmingState, Request

_LONGEST_S = 150.0


@dataclass(frozen=True, slots=True)
class Performed:
    """A trial as a log of it would tell."""

    ticks: list[Tick]
    scene: list[SceneTruth]
    outcome: Outcome


class _Eyes:
    """The true scene, at his rate of glances and as late as his hand can act on it."""

    def __init__(self, profile: ParticipantProfile) -> None:
        self._sampling_ns = round(profile.sampling_s * NS_PER_S)
        self._delay_ns = round(profile.visuomotor_s * NS_PER_S)
        self._glances: deque[SceneTruth] = deque()
        self.now_ns = 0

    def glance(self, truth: SceneTruth) -> None:
        self.now_ns = truth.t_ns
        if not self._glances or truth.t_ns - self._glances[-1].t_ns >= self._sampling_ns:
            self._glances.append(truth)

    def read(self) -> SceneTruth | None:
        acted_on_ns = self.now_ns - self._delay_ns
        while len(self._glances) > 1 and self._glances[1].t_ns <= acted_on_ns:
            self._glances.popleft()
        seen = self._glances[0]
        return seen if seen.t_ns <= acted_on_ns else None


class VirtualTrial:
    """Scene `seed` with participant `seed`, tick by tick."""

    def __init__(self, config: Config, seed: int) -> None:
        self._config = config
        self._clock = VirtualClock()
        joints = np.radians(np.array(config.arm.ready_joints_deg))
        self._world = World(draw_layout(seed), joints)
        profile = ParticipantProfile.draw(seed)
        self._eyes = _Eyes(profile)
        asked = EfferenceCopy()
        eyes = TruePerception(self._eyes.read)
        operator = Operator(config.hand, config.rig.operator, eyes, seed, True, profile, asked)
        controller = VirtualController(operator, config.rig.operator, seed)
        boundary = session_boundary(config.arm, config.limits)
        model = ControllerModel(self._world, joints)
        self._arm = InProcessArm(config.arm, self._clock, model, boundary)
        self._supervisor = ArmSupervisor(
            self._arm, ServoMode(config.arm.servo), boundary, lambda *_: None
        )
        self._judge = TrialJudge(config.trial, build.task_geometry())
        self._ticks: list[Tick] = []
        self._scene: list[SceneTruth] = []
        self._loop = ControlLoop(
            self._clock,
            config.control.rate_hz,
            controller,
            self._arm,
            build.teleop(config, 0),
            build.phase_tracker(config),
            build.smoothed_speed(config),
            Signals(),
            self._hooks(),
        )
        self._arm.connect()
        controller.start()

    def perform(self) -> Iterator[float]:
        """Go on until placed or out of time; yields the seconds gone by, at each record of the
        scene."""
        start_ns = self._clock.now_ns()
        period_ns = round(NS_PER_S / self._config.control.rate_hz)
        scene_ns = start_ns
        ended = False
        while not ended and self._clock.now_ns() - start_ns < _LONGEST_S * NS_PER_S:
            self._clock.advance_ns(period_ns)
            now_ns = self._clock.now_ns()
            state = self._arm.state()  # brings the world up to the clock
            truth = self._world.truth(now_ns)
            self._eyes.glance(truth)
            output = self._loop.tick(now_ns)
            if output.deadman and output.arming is ArmingState.ENGAGED:
                self._judge.engaged(now_ns)
            ended = self._judge.step(now_ns, truth, state.gripper_closed if state else None)
            if now_ns >= scene_ns:
                scene_ns += round(NS_PER_S / SCENE_RATE_HZ)
                self._scene.append(truth)
                yield (now_ns - start_ns) / NS_PER_S
        self._arm.close()

    def performed(self) -> Performed:
        """What was recorded so far."""
        return Performed(self._ticks, self._scene, self._judge.outcome())

    def _hooks(self) -> ControlHooks:
        return ControlHooks(
            beat=lambda _: None,
            video_age_ns=lambda *_: 0,
            request=self._carry_out,
            arm_ready=lambda: self._supervisor.ready,
            phase_began=lambda _: None,
            record=self._ticks.append,
            output=lambda *_: None,
        )

    def _carry_out(self, request: Request) -> None:
        self._supervisor.carry_out(request, 0)

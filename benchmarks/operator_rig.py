"""The operator who sees, at a rig in virtual time, with the pictures as the cameras take them.

No codec, no link, no delay: what his parameters are set by, and a bench for what delay and blur do
to him. Everything between hand and arm is the product's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
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
from hw.sim.scene import VIEWS
from hw.sim.scene_renderer import HEIGHT, WIDTH, SceneRenderer
from hw.sim.seeing import Reliance, SeeingPerception
from hw.sim.sensor_noise import SensorNoise
from hw.sim.task import Stage
from hw.sim.virtual_controller import VirtualController
from hw.sim.world import World
from tams_app.clock import NS_PER_MS, NS_PER_S, VirtualClock
from tams_app.config import Config
from tams_app.records import Image, Outcome, Vector
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.signals import Signals
from tams_app.session.supervisor import ArmSupervisor
from tams_app.study.trial import TrialJudge
from tams_app.teleop.safety import Request

Distort = Callable[[str, Image], Image]


@dataclass(frozen=True, slots=True)
class Watched:
    """What a spectator notes at each glance; `true_gap` never reaches the operator."""

    stage: Stage
    reliance: Reliance
    believed_gap: Vector  # from tool to block [m], shape (3,), at the glance
    true_gap: Vector


class Screen:
    """The newest picture of each view, drawn only when somebody looks."""

    def __init__(
        self, config: Config, renderer: SceneRenderer, delay_ns: int, distort: Distort
    ) -> None:
        self._renderer = renderer
        self._distort = distort
        self._delay_ns = delay_ns
        self._period_ns = NS_PER_S // config.video.fps
        self._taken: dict[str, deque[tuple[int, int, Vector]]] = {v: deque() for v in VIEWS}
        sigma = config.rig.camera_noise_sigma
        self._noises = {
            view: SensorNoise(config.seed, view, sigma, HEIGHT, WIDTH) for view in VIEWS
        }
        self.now_ns = 0

    def take(self, now_ns: int, qpos: Vector) -> None:
        """Let time go on: a camera whose instant has come captures."""
        self.now_ns = now_ns
        for place, view in enumerate(VIEWS):
            index = (now_ns - place * self._period_ns // len(VIEWS)) // self._period_ns
            taken = self._taken[view]
            if not taken or taken[-1][1] < index:
                taken.append((now_ns, index, qpos))
            while len(taken) > 1 and taken[1][0] <= now_ns - self._delay_ns:
                taken.popleft()

    def pictures(self) -> Mapping[str, Image | None]:
        """What is on screen: None for a view until its first picture has arrived."""
        shown: dict[str, Image | None] = {}
        for view in VIEWS:
            t_ns, index, qpos = self._taken[view][0]
            shown[view] = None
            if t_ns <= self.now_ns - self._delay_ns:
                image = self._renderer.render(view, qpos)
                self._noises[view].apply(image, index)
                shown[view] = self._distort(view, image)
        return shown


def _as_it_is(_view: str, image: Image) -> Image:
    return image


def _ignore(*_: object) -> None:
    """Nobody records this rig."""


class OperatorRig:
    """One trial of one participant; `run` ends when it is judged. Close it in the same thread."""

    def __init__(
        self, config: Config, participant: int, delay_ms: float = 0.0, distort: Distort = _as_it_is
    ) -> None:
        """`distort`: what becomes of each picture before it is shown (a bench's, not a codec's)."""
        layout = draw_layout(config.seed)
        joints = np.radians(np.array(config.arm.ready_joints_deg))
        self._config = config
        self._clock = VirtualClock()
        self.world = World(layout, joints)
        self._renderer = SceneRenderer(layout)
        self._screen = Screen(config, self._renderer, round(delay_ms * NS_PER_MS), distort)
        self.watched: list[Watched] = []
        profile = ParticipantProfile.draw(participant)
        asked = EfferenceCopy()
        self.eyes = SeeingPerception(
            self._screen.pictures, asked, profile.sampling_s, profile.visuomotor_s, self._note
        )
        self.operator = Operator(
            config.hand, config.rig.operator, self.eyes, participant, True, profile, asked
        )
        self._controller = VirtualController(self.operator, config.rig.operator, config.seed)
        self._arm = InProcessArm(
            config.arm,
            self._clock,
            ControllerModel(self.world, joints),
            session_boundary(config.arm, config.limits),
        )
        self._supervisor = ArmSupervisor(
            self._arm,
            ServoMode(config.arm.servo),
            session_boundary(config.arm, config.limits),
            lambda *_: None,
        )
        self._judge = TrialJudge(config.trial, build.task_geometry())
        self.loop = ControlLoop(
            self._clock,
            config.control.rate_hz,
            self._controller,
            self._arm,
            build.teleop(config, round(delay_ms * NS_PER_MS)),
            build.phase_tracker(config),
            build.smoothed_speed(config),
            Signals(),
            ControlHooks(
                beat=_ignore,
                video_age_ns=lambda *_: round(delay_ms * NS_PER_MS),
                request=self._carry_out,
                arm_ready=lambda: self._supervisor.ready,
                phase_began=_ignore,
                record=_ignore,
                output=_ignore,
            ),
        )
        self._arm.connect()
        self._controller.start()

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns()

    def run(self, longest_s: float = 150.0) -> Outcome:
        """Until it is placed, out of time, or `longest_s` are over."""
        end_ns = self.now_ns + round(longest_s * NS_PER_S)
        while self.now_ns < end_ns and not self.tick():
            pass
        return self._judge.outcome()

    def tick(self) -> bool:
        """One control period; True once the trial has ended."""
        self._clock.advance_ns(round(NS_PER_S / self._config.control.rate_hz))
        self._arm.state()  # brings the world up to the clock
        self._screen.take(self.now_ns, self.world.qpos)
        self.eyes.watch(self.now_ns)
        output = self.loop.tick(self.now_ns)
        if output.deadman and output.arming.value == "engaged":
            self._judge.engaged(self.now_ns)
        state = self._arm.state()
        closed = state.gripper_closed if state is not None else None
        return self._judge.step(self.now_ns, self.world.truth(self.now_ns), closed)

    def close(self) -> None:
        """Give the graphics back."""
        self._arm.close()
        self._renderer.close()

    def _carry_out(self, request: Request) -> None:
        self._supervisor.carry_out(request, 0)

    def _note(self, reliance: Reliance) -> None:
        truth = self.world.truth(self.now_ns)
        self.watched.append(
            Watched(
                self.operator.stage,
                reliance,
                self.eyes.gap_to_block,
                truth.block.position - truth.tcp.position,
            )
        )

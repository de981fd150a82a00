"""The seeing operator at a rig in virtual time, with the images as the cameras take them.

No codec, no link, no delay: the operator's parameters were fitted on it, and it shows what delay
and blur do. Everything between hand and arm is the product's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchmarks.operator_calibration import NormalisedErrors, normalised_errors
from hw.sim.operator.seeing import OnScreen, SeeingParticipant
from hw.sim.operator.task import Stage
from hw.sim.viewpoints import VIEWS
from hw.sim.world.camera_images import CameraImages, stagger_ns
from tams_app.config import Config
from tams_app.records import Image, OperatorGlance, Outcome, SceneTruth, Vector
from tams_app.robot import build
from tams_app.robot.control import Signals, SteadyVideo
from tams_app.runtime.clock import VirtualClock
from tams_app.session.virtual.rig import VirtualRobot
from tams_app.task.judge import TrialJudge
from tams_app.units import NS_PER_MS, NS_PER_S

Distort = Callable[[str, Image], Image]


@dataclass(frozen=True, slots=True)
class Watched:
    """What a spectator notes at each glance; `true_gap` never reaches the operator."""

    stage: Stage
    glance: OperatorGlance
    believed_gap: Vector  # from tool to block [m], shape (3,), at the glance
    true_gap: Vector
    errors: NormalisedErrors  # against what the images on screen showed


class Screen:
    """The newest frame of each view, drawn only when it is looked at."""

    def __init__(
        self, config: Config, cameras: CameraImages, delay_ns: int, distort: Distort
    ) -> None:
        self._cameras = cameras
        self._distort = distort
        self._delay_ns = delay_ns
        self._period_ns = NS_PER_S // config.video.fps
        self._taken: dict[str, deque[tuple[int, int, Vector, SceneTruth]]] = {
            view: deque() for view in VIEWS
        }
        self.now_ns = 0

    def take(self, now_ns: int, qpos: Vector, truth: SceneTruth) -> None:
        """Let time go on: a camera whose instant has come captures; `truth` is for spectators."""
        self.now_ns = now_ns
        for view in VIEWS:
            index = (now_ns - stagger_ns(view, self._period_ns)) // self._period_ns
            taken = self._taken[view]
            if not taken or taken[-1][1] < index:
                taken.append((now_ns, index, qpos, truth))
            while len(taken) > 1 and taken[1][0] <= now_ns - self._delay_ns:
                taken.popleft()

    def images(self) -> Mapping[str, Image | None]:
        """What is on screen: None for a view until its first frame has arrived."""
        shown: dict[str, Image | None] = {}
        for view in VIEWS:
            t_ns, index, qpos, _ = self._taken[view][0]
            shown[view] = None
            if t_ns <= self.now_ns - self._delay_ns:
                shown[view] = self._distort(view, self._cameras.take(view, index, qpos))
        return shown

    def shown(self) -> list[SceneTruth]:
        """What was the case in the images that are on screen."""
        newest = [self._taken[view][0] for view in VIEWS]
        return [truth for t_ns, _, _, truth in newest if t_ns <= self.now_ns - self._delay_ns]


def _as_it_is(_view: str, image: Image) -> Image:
    return image


def _ignore(*_: object) -> None:
    """This rig is not recorded."""


class OperatorRig:
    """One trial of one participant; `run` ends when it is judged. Close it in the same thread."""

    def __init__(
        self, config: Config, participant: int, delay_ms: float = 0.0, distort: Distort = _as_it_is
    ) -> None:
        """`distort`: what becomes of each frame before it is shown (a bench's, not a codec's)."""
        delay_ns = round(delay_ms * NS_PER_MS)
        self._config = config
        self._clock = VirtualClock()
        self._robot = robot = VirtualRobot(config, self._clock, _ignore)
        sigma = config.rig.camera_noise_sigma
        self._cameras = CameraImages(robot.layout, config.seed, sigma)
        self._screen = Screen(config, self._cameras, delay_ns, distort)
        self.watched: list[Watched] = []
        self._participant = seeing = SeeingParticipant(
            config, participant, lambda _: OnScreen(self._screen.images()), self._note
        )
        self.eyes, self.operator = seeing.eyes, seeing.operator
        self._judge = TrialJudge(config.trial, build.task_geometry())
        video = SteadyVideo(delay_ns)
        self.loop = build.control_loop(
            config,
            self._clock,
            seeing.controller,
            robot.arm,
            robot.gate,
            video,
            delay_ns,
            Signals(),
        )
        robot.arm.connect()
        seeing.controller.start()

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
        self._robot.catch_up()
        self._screen.take(self.now_ns, self._robot.qpos, self._robot.truth())
        self._participant.watch(self.now_ns)
        output = self.loop.tick(self.now_ns)
        self._robot.gate.serve()
        if output.deadman and output.arming.value == "engaged":
            self._judge.engaged(self.now_ns)
        truth, closed = self._robot.truth(), self._robot.gripper_closed()
        return self._judge.step(self.now_ns, truth, closed)

    def close(self) -> None:
        """Give the graphics back."""
        self._robot.arm.close()
        self._cameras.close()

    def _note(self, glance: OperatorGlance) -> None:
        truth, stage = self._robot.truth(), self.operator.stage
        shown = self._screen.shown()
        self.watched.append(
            Watched(
                stage,
                glance,
                self.eyes.belief.block - self.eyes.belief.tcp,
                truth.block.position - truth.tcp.position,
                normalised_errors(self.eyes.belief, stage, self.eyes.asked_speed_m_s, shown),
            )
        )

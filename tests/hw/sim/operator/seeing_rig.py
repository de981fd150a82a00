"""A seeing participant at a rig in virtual time, with the images as the cameras take them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hw.sim.layout import VIEWS
from hw.sim.operator.seeing import OnScreen, SeeingParticipant
from hw.sim.world.scene_renderer import CameraImages
from tams_app.config import Config
from tams_app.records import Image, OperatorGlance, Vector
from tams_app.robot import build
from tams_app.robot.control import Signals, SteadyVideo
from tams_app.runtime.clock import VirtualClock
from tams_app.session.virtual.rig import VirtualRobot
from tams_app.units import NS_PER_MS, NS_PER_S

FRAME_NS = NS_PER_S // 30


@dataclass(frozen=True, slots=True)
class Seen:
    """What was known at a glance, from tool to block [m], shape (3,); the truth stays with us."""

    glance: OperatorGlance
    believed_gap: Vector
    true_gap: Vector
    present_gap: Vector  # as believed, less what the hand has asked since


class SeeingRig:
    """No codec and no link: what is taken is shown `delay_ms` later, as `distort` makes it."""

    def __init__(
        self,
        config: Config,
        participant: int,
        cameras: CameraImages,
        delay_ms: float = 0.0,
        distort: Callable[[Image], Image] = lambda image: image,
        ahead: frozenset[str] = frozenset(),
        titled: bool = True,
    ) -> None:
        """`ahead`: views that show the present for all that; `titled`: as their titles say."""
        self._config = config
        self._clock = VirtualClock()
        self._robot = robot = VirtualRobot(config, self._clock, _ignore)
        self._cameras = cameras
        self._delay_ns = round(delay_ms * NS_PER_MS)
        self._distort, self._ahead, self._titled = distort, ahead, titled
        self._taken: deque[tuple[int, Vector]] = deque()
        self.frozen = False  # the screen keeps showing what it shows
        self.glances: list[Seen] = []
        self._participant = SeeingParticipant(config, participant, self._screen, self._note)
        self.operator, self._eyes = self._participant.operator, self._participant.eyes
        self._asked = self._eyes._asked
        controller = self._participant.controller
        delay_ns = self._delay_ns
        video = SteadyVideo(delay_ns)
        self._loop = build.control_loop(
            config, self._clock, controller, robot.arm, robot.gate, video, delay_ns, Signals()
        )
        robot.arm.connect()
        controller.start()

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns()

    @property
    def tcp(self) -> Vector:
        """Where the tool truly is [m]."""
        return self._robot.truth().tcp.position

    def tick(self) -> None:
        """One control period."""
        self._clock.advance_ns(round(NS_PER_S / self._config.control.rate_hz))
        self._robot.catch_up()
        if not self._taken or self.now_ns - self._taken[-1][0] >= FRAME_NS:
            self._taken.append((self.now_ns, self._robot.qpos))
        shown_ns = 0 if self.frozen else self.now_ns - self._delay_ns
        while len(self._taken) > 1 and self._taken[1][0] <= shown_ns:
            self._taken.popleft()
        self._participant.watch(self.now_ns)
        self._loop.tick(self.now_ns)
        self._robot.gate.serve()

    def images(self) -> Mapping[str, Image | None]:
        """What is on screen, by view: None until the first frame has arrived."""
        t_ns, qpos = self._taken[0]
        if t_ns > self.now_ns - self._delay_ns:
            return dict.fromkeys(VIEWS)
        index = t_ns // FRAME_NS
        return {view: self._distort(self._cameras.take(view, index, qpos)) for view in VIEWS}

    def _screen(self, now_ns: int) -> OnScreen:
        images = dict(self.images())
        for view in self._ahead:
            image = self._cameras.take(view, now_ns // FRAME_NS, self._robot.qpos)
            images[view] = self._distort(image)
        return OnScreen(images, self._ahead if self._titled else frozenset())

    def close(self) -> None:
        self._robot.arm.close()

    def _note(self, glance: OperatorGlance) -> None:
        truth = self._robot.truth()
        gap = truth.block.position - truth.tcp.position
        belief = self._eyes.belief
        believed = belief.block - belief.tcp
        asked = self._asked.total - self._asked.asked_at(glance.t_ns - glance.lag_ns)
        self.glances.append(Seen(glance, believed, gap, believed - asked[:3]))


def _ignore(*_: object) -> None:
    """For what these tests do not look at."""

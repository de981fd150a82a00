"""A seeing participant at a rig in virtual time, and eyes alone before images that a test shows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.sim.layout import VIEWS
from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.seeing import OnScreen, SeeingParticipant, SeeingPerception
from hw.sim.operator.task import Stage
from hw.sim.world.scene_renderer import CameraImages
from tams_app.config import Config
from tams_app.records import Image, OperatorGlance, Vector
from tams_app.robot import build
from tams_app.robot.control import LoopDevices, Signals, SteadyVideo
from tams_app.runtime.clock import VirtualClock
from tams_app.session.virtual.side import VirtualRobot
from tams_app.units import NS_PER_MS, NS_PER_S

FRAME_NS = NS_PER_S // 30
TICK_NS = 8 * NS_PER_MS
GLANCE_NS = 10 * TICK_NS


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
        self._participant = SeeingParticipant(config, participant, self._screen)
        self.operator, self._eyes = self._participant.operator, self._participant.eyes
        self._asked = self._eyes._asked
        controller = self._participant.controller
        delay_ns = self._delay_ns
        devices = LoopDevices(controller, robot.arm, robot.gate, SteadyVideo(delay_ns))
        self._loop = build.control_loop(config, self._clock, devices, delay_ns, Signals())
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
        glance = self._participant.watch(self.now_ns)
        if glance is not None:
            self._note(glance)
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


class Eyes:
    """The eyes, and what they tell of whatever is on the `screen`."""

    def __init__(self, screen: Mapping[str, Image | None] | None = None) -> None:
        self.screen: dict[str, Image | None] = dict(screen or {})
        self.told: list[OperatorGlance] = []
        self.looks = 0
        self.now_ns = NS_PER_S
        self._asked = EfferenceCopy()
        self.seeing = SeeingPerception(self._shown, self._asked, GLANCE_NS / NS_PER_S, 0.12)

    def run(self, seconds: float, speed_m_s: float = 0.0, tick_ns: int = TICK_NS) -> None:
        """Look for so long, while the hand asks the tool to move."""
        for _ in range(round(seconds * NS_PER_S / tick_ns)):
            self.now_ns += tick_ns
            moved = np.array([0.0, speed_m_s * tick_ns / NS_PER_S, 0.0])
            self._asked.add(self.now_ns, moved, np.zeros(3))
            glance = self.seeing.watch(self.now_ns, Stage.REACH)
            if glance is not None:
                self.told.append(glance)

    def show(self, images: Any, glances: int) -> None:
        """Look so often, the hand at rest, at these images or at what they are at each glance."""
        for glance in range(glances):
            self.screen = images(glance) if callable(images) else images
            self.run(GLANCE_NS / NS_PER_S, tick_ns=GLANCE_NS)

    def _shown(self, _now_ns: int) -> OnScreen:
        self.looks += 1
        return OnScreen(self.screen)

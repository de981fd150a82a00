"""The rig's three cameras in virtual time, plugged in an unknown order, and a simulated person."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from calibration.cameras.bench import Arm, Task
from calibration.cameras.board import Board
from calibration.cameras.flashes import Flashes
from calibration.cameras.simulated_person import BoardPainter, CameraPerson
from hw.arms import arm_kind
from hw.sim.layout import HEIGHT_PX, WIDTH_PX, draw_layout
from hw.sim.world.scene_renderer import SceneRenderer, SensorNoise
from hw.sim.world.world import World
from tams_app.config import CameraConfig, Config
from tams_app.records import NO_DISTORTION, Frame, Image, Vector
from tams_app.runtime.clock import VirtualClock
from tams_app.session.lenses import rig_lens
from tams_app.units import NS_PER_MS, NS_PER_S

_SEED, _BOARD_SEED = 0xCA3, 0xB0A
_JITTER_MS = 0.3
Distortion: TypeAlias = tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class CameraTruth:
    """What a simulated camera is like, to check the wizard against."""

    view: str
    latency_ms: float  # from the middle of its exposure to its timestamp
    exposure_ms: float
    phase_ns: int


class SimulatedBench:
    """Images of the rig at rest, rendered once, with what the person holds before them."""

    source = "the simulated rig and a simulated person"
    attended = False

    def __init__(
        self, config: Config, seed: int, distortion: Mapping[str, Distortion] | None = None
    ) -> None:
        """`distortion`: by view, of cameras that shall distort. SetupError without OpenGL."""
        self.fps, self.width, self.height = config.video.fps, WIDTH_PX, HEIGHT_PX
        self._clock = VirtualClock()
        self._random = np.random.default_rng([_SEED, seed])
        self.truth = _draw_truth(config.video.views, self._random, self.fps)
        self._scenes = _scenes(config, seed)
        self._noise = {name: SensorNoise(seed, truth.view) for name, truth in self.truth.items()}
        self._flashes: Flashes | None = None
        self.refused: Sequence[str] = ()
        figure = arm_kind(config.arm.model).figure()
        assert figure is not None, "the rig's arm has one"
        ideal = {view: rig_lens(view, figure, (WIDTH_PX, HEIGHT_PX)) for view in config.video.views}
        self._ideal = {view: lens for view, lens in ideal.items() if lens is not None}
        # how the cameras truly see and where they are, to check the wizard against
        self.lenses = {
            view: replace(lens, distortion=(distortion or {}).get(view, NO_DISTORTION))
            for view, lens in self._ideal.items()
        }
        self._ready = np.radians(config.arm.ready_joints_deg)
        random = np.random.default_rng([_BOARD_SEED, seed])
        self._person = CameraPerson(self.lenses, figure, self._ready, random)
        self._board, self._painters = Board(), dict[str, BoardPainter]()
        self._layout = draw_layout(seed)
        self._renderer: SceneRenderer | None = None
        self._last: dict[str, tuple[bytes, Image]] = {}  # by view: what was seen where

    @property
    def cameras(self) -> Sequence[str]:
        return tuple(self.truth)

    def binding(self, camera: str) -> dict[str, str]:
        return {
            "source": "v4l2",
            "name": "",
            "serial": f"SIMULATED-{camera[-1]}",
            "path": "",
            "file": "",
        }

    def camera_of(self, config: CameraConfig) -> str:
        found = [name for name in self.truth if self.binding(name)["serial"] == config.serial]
        return found[0] if found else ""

    def prompt(self, task: Task, view: str) -> None:
        self._person.ask(task, view, self._clock.now_ns())

    @property
    def done(self) -> bool:
        return self._person.finished(self._clock.now_ns())

    @contextmanager
    def arm(self) -> Iterator[Arm]:
        yield lambda: self._person.joints(self._clock.now_ns())

    def shots(self, cameras: Sequence[str], seconds: float, every: int = 1) -> Iterator[Frame]:
        start_ns = self._clock.now_ns()
        end_ns = start_ns + round(seconds * NS_PER_S)
        due = [self._next(name, start_ns) for name in cameras]
        heapq.heapify(due)
        while due and due[0][0] < end_ns:
            at_ns, name, index = due[0]
            heapq.heapreplace(due, self._next(name, at_ns + 1))
            if index % every:
                continue
            self._clock.sleep_until_ns(at_ns)
            yield self._shot(name, index, at_ns)
        self._clock.sleep_until_ns(end_ns)

    def _next(self, name: str, from_ns: int) -> tuple[int, str, int]:
        """When the camera's first frame from a time on begins, and its index."""
        truth = self.truth[name]
        index = math.ceil((from_ns - truth.phase_ns) * self.fps / NS_PER_S)
        return truth.phase_ns + math.ceil(index * NS_PER_S / self.fps), name, index

    @contextmanager
    def screen(self) -> Iterator[Flashes]:
        self._flashes = Flashes.beginning(self._clock.now_ns())
        try:
            yield self._flashes
        finally:
            self._flashes = None

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _shot(self, name: str, index: int, start_ns: int) -> Frame:
        truth = self.truth[name]
        end_ns = start_ns + round(truth.exposure_ms * NS_PER_MS)
        lit = None if self._flashes is None else self._flashes.lit_share(start_ns, end_ns)
        scene = self._seen(truth.view, start_ns)
        image = self._person.seen(truth.view, scene, start_ns, end_ns, lit)
        self._noise[name].apply(image, index)
        jitter_ms = float(self._random.normal(0, _JITTER_MS))
        capture_ns = (start_ns + end_ns) // 2 + round((truth.latency_ms + jitter_ms) * NS_PER_MS)
        return Frame(name, index, capture_ns, image)

    def _seen(self, view: str, now_ns: int) -> Image:
        """What a camera sees now; the same array as long as nothing moves."""
        if view not in self._painters:
            self._painters[view] = BoardPainter(self.lenses[view], self._ideal[view])
        painter, joints = self._painters[view], self._person.joints(now_ns)
        board = self._person.board(view, now_ns)
        placed = () if board is None else (*board.position, *board.rotation)
        what = np.array([*joints, *placed]).tobytes()
        known = self._last.get(view)
        if known is None or known[0] != what:
            is_ready = np.array_equal(joints, self._ready)
            image = painter.scene(self._scenes[view] if is_ready else self._rendered(view, joints))
            if board is not None:
                image = painter.paint(image, self._board, board, self._person.hidden(view, now_ns))
            known = self._last[view] = what, image
        return known[1]

    def _rendered(self, view: str, joints: Vector) -> Image:
        if self._renderer is None:
            self._renderer = SceneRenderer(self._layout)
        return self._renderer.render(view, World(self._layout, joints).qpos)


def _draw_truth(
    views: Sequence[str], random: np.random.Generator, fps: int
) -> dict[str, CameraTruth]:
    """Cameras named A, B, C in an order that has nothing to do with the views."""
    return {
        f"camera {letter}": CameraTruth(
            view=str(view),
            latency_ms=float(random.uniform(5, 45)),
            exposure_ms=float(random.uniform(6, 14)),
            phase_ns=int(random.uniform(0, NS_PER_S / fps)),
        )
        for letter, view in zip("ABCDEFGH", random.permutation(list(views)), strict=False)
    }


def _scenes(config: Config, seed: int) -> dict[str, Image]:
    layout = draw_layout(seed)
    qpos = World(layout, np.radians(config.arm.ready_joints_deg)).qpos
    renderer = SceneRenderer(layout)
    try:
        return {view: renderer.render(view, qpos) for view in config.video.views}
    finally:
        renderer.close()

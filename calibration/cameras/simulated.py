"""`calibrate cameras --sim`: the rig's cameras in virtual time, in an unknown order, and a person.

The person does before them what the wizard asks for, and that is in their pictures.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np

from calibration.cameras.bench import Task
from calibration.cameras.board import Board, BoardPainter
from calibration.cameras.flashes import Flashes
from hw.arms import arm_kind
from hw.sim.layout import HEIGHT_PX, WIDTH_PX, draw_layout
from hw.sim.world.scene_renderer import SceneRenderer, SensorNoise
from hw.sim.world.world import World
from tams_app.config import CameraConfig, Config
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import NO_DISTORTION, ArmFigure, Frame, Image, Lens, Pose, Vector
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.session.lenses import BASE, rig_lens
from tams_app.units import NS_PER_MS, NS_PER_S

_SEED, _BOARD_SEED = 0xCA3, 0xB0A
_JITTER_MS = 0.3
_SKIN = (120, 150, 205)  # BGR
_SCREEN_BLACK, _SCREEN_WHITE = 25.0, 215.0  # grey levels of the screen in an image
_GAMMA = 2.2
_HELD_S = 0.6
_SHOWN, _ARM_POSES, _PLACES = 36, 30, 8
_PLACED_S = 3.0
_TILT_RAD = 0.65
# of the joints about where it is ready
_SPREAD_RAD = np.radians((25.0, 20.0, 20.0, 45.0, 30.0, 70.0))
_NEAREST_M, _FARTHEST_M = 0.16, 0.40  # of the board's middle from the camera on the arm
_LOWEST_M = 0.10  # of the flange
_TRIES = 20_000
_SEEN_SHARE = 0.8  # of the board's corners, by a camera on the arm
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
        self.cameras: Sequence[str] = tuple(self.truth)
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
    def listening(self) -> Iterator[None]:
        yield

    def joints(self) -> Vector | None:
        return self._person.joints(self._clock.now_ns())

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
                image = painter.paint(image, self._board, board)
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


class CameraPerson:
    """Does what was asked last, and knows when it is finished; all of it in virtual time."""

    def __init__(
        self,
        lenses: Mapping[str, Lens],
        figure: ArmFigure,
        ready: Vector,
        random: np.random.Generator,
    ) -> None:
        """`lenses`: as the cameras truly are and stand. `ready`: joints [rad], shape (6,)."""
        self._lenses, self._figure, self._ready, self._random = lenses, figure, ready, random
        self._board = Board()
        self._task, self._view, self._since_ns = Task.REST, "", 0
        self._held: list[Pose] = []  # in the camera
        self._places = [self._place(number) for number in range(_PLACES)]
        self._at = -1  # the place of the board
        self._arms: list[Vector] = []

    def ask(self, task: Task, view: str, now_ns: int) -> None:
        """Begin to do it for `view`, "" for all."""
        self._task, self._view, self._since_ns = task, view, now_ns
        self._arms = []
        if task is Task.SHOW_BOARD:
            self._held = [self._hold(self._lenses[view], number) for number in range(_SHOWN)]
        elif task is Task.MOVE_ARM:
            self._at = 0
            self._arms = [self._arm_that_sees(self._places[0]) for _ in range(_ARM_POSES)]
        elif task is Task.MOVE_BOARD:
            self._at = (self._at + 1) % _PLACES
            self._arms = [self._arm_that_sees(self._places[self._at])]

    def finished(self, now_ns: int) -> bool:
        """Whether what was asked is done; waving and resting have no end of their own."""
        after_s = (now_ns - self._since_ns) / NS_PER_S
        lasts = {
            Task.SHOW_SCREEN: 0.0,
            Task.SHOW_BOARD: _SHOWN * _HELD_S,
            Task.MOVE_ARM: _ARM_POSES * _HELD_S,
            Task.MOVE_BOARD: _PLACED_S,
        }
        return self._task in lasts and after_s >= lasts[self._task]

    def seen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, lit_share: float | None
    ) -> Image:
        """What `view` sees in an exposure; `lit_share`: of it the screen is white, if there is one.

        The screen's light adds up over the exposure; grey levels do not.
        """
        middle_s = ((start_ns + end_ns) / 2 - self._since_ns) / NS_PER_S
        meant = self._view in ("", view)
        image = scene.copy()
        if self._task is Task.WAVE:
            _draw_hand(image, middle_s, 1.0 if meant else 0.12)
        elif self._task is Task.SHOW_SCREEN and meant and lit_share is not None:
            level = _SCREEN_BLACK + (_SCREEN_WHITE - _SCREEN_BLACK) * lit_share ** (1 / _GAMMA)
            image[40:-40, 40:-40] = round(level)
        return image

    def joints(self, now_ns: int) -> Vector:
        """Of the arm [rad], shape (6,)."""
        arms = self._arms or [self._ready]
        return arms[min(self._step(now_ns), len(arms) - 1)]

    def board(self, view: str, now_ns: int) -> Pose | None:
        """Where it is in the frame of the camera of `view`; None: out of its sight."""
        if self._task is Task.SHOW_BOARD:
            held = self._held[min(self._step(now_ns), _SHOWN - 1)]
            return held if view == self._view else None
        if self._task not in (Task.MOVE_ARM, Task.MOVE_BOARD):
            return None
        return mounted(inverse(self._camera(view, self.joints(now_ns))), self._places[self._at])

    def _step(self, now_ns: int) -> int:
        return int((now_ns - self._since_ns) / NS_PER_S / _HELD_S)

    def _camera(self, view: str, joints: Vector) -> Pose:
        lens = self._lenses[view]
        if lens.parent == BASE:
            return lens.pose
        return mounted(self._figure.place(joints)[lens.parent], lens.pose)

    def _middle(self, board: Pose) -> Vector:
        width, height = self._board.size_m
        return np.asarray(board.position + board.rotation.apply((width / 2, height / 2, 0.0)))

    def _hold(self, lens: Lens, number: int) -> Pose:
        """Before one camera: in turn at nine parts of the picture, half as wide as it is.

        Tilted, and in a last round nearly straight, which reaches the corners of the picture.
        """
        across, down = 0.2 + 0.3 * (number % 3), 0.22 + 0.28 * (number // 3 % 3)
        tilt = _TILT_RAD if number < 2 * _SHOWN // 3 else _TILT_RAD / 4
        slope = lens.slopes(np.array([(across * lens.width, down * lens.height)]))[0]
        distance = lens.fx * self._board.size_m[0] / (0.45 * lens.width)
        turn = self._random.uniform(-tilt, tilt, 3).tolist()
        return self._about(np.array([*slope, 1.0]) * distance, Rotation.from_rotvec(turn))

    def _place(self, number: int) -> Pose:
        """On the table, propped up towards the cameras that stand before it."""
        random = self._random
        azimuth = np.radians(-45.0 + random.uniform(-35.0, 35.0))
        lean = np.radians((20.0, 40.0, 30.0)[number % 3] + random.uniform(-5.0, 5.0))
        up = np.array(
            [np.sin(lean) * np.cos(azimuth), np.sin(lean) * np.sin(azimuth), np.cos(lean)]
        )
        right = np.cross((0.0, 0.0, 1.0), up)
        right /= np.linalg.norm(right)
        axes = np.column_stack((right, np.cross(-up, right), -up))
        height = 0.5 * self._board.size_m[1] * np.sin(lean)
        middle = np.array([0.34 + random.uniform(-0.04, 0.05), random.uniform(-0.08, 0.06), height])
        return self._about(middle, Rotation.from_matrix(axes))

    def _about(self, middle: Vector, rotation: Rotation) -> Pose:
        width, height = self._board.size_m
        return Pose(middle - rotation.apply((width / 2, height / 2, 0.0)), rotation)

    def _arm_that_sees(self, board: Pose) -> Vector:
        """Joints from which the camera on the arm has most of the board in its picture."""
        view, lens = next((view, one) for view, one in self._lenses.items() if one.parent != BASE)
        corners = board.position + board.rotation.apply(self._board.corners)
        for _ in range(_TRIES):
            joints = self._ready + self._random.uniform(-1.0, 1.0, 6) * _SPREAD_RAD
            camera = self._camera(view, joints)
            distance = float(np.linalg.norm(self._middle(board) - camera.position))
            flange = self._figure.place(joints)[lens.parent]
            if not _NEAREST_M < distance < _FARTHEST_M or flange.position[2] < _LOWEST_M:
                continue
            axes = camera.rotation.as_matrix()
            seen = (corners - camera.position) @ axes
            if (seen[:, 2] <= 0.0).any() or axes[:, 2] @ board.rotation.as_matrix()[:, 2] < 0.5:
                continue  # behind it, or seen from too far aside
            pixels = lens.pixels(seen[:, :2] / seen[:, 2:])
            inside = ((pixels > 0) & (pixels < (lens.width, lens.height))).all(axis=1)
            if inside.mean() >= _SEEN_SHARE:
                return np.asarray(joints)
        raise AssertionError("no pose of the arm sees the board")


def _draw_hand(image: Image, after_s: float, size: float) -> None:
    height, width = image.shape[:2]
    centre = (
        int(width * (0.5 + 0.25 * math.sin(7.0 * after_s))),
        int(height * (0.5 + 0.1 * math.cos(5.0 * after_s))),
    )
    axes = (max(3, int(0.2 * size * width)), max(3, int(0.3 * size * height)))
    cv2.ellipse(image, centre, axes, 15 * math.sin(6 * after_s), 0, 360, _SKIN, -1)

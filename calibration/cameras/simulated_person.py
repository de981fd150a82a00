"""A simulated person: what they hold before a camera of the rig, and do to it, as prompted."""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.cameras.bench import Task
from calibration.cameras.board import Board
from calibration.cameras.latency import ScreenTimes
from calibration.cameras.plane import GAMMA, Lens, Placed, Window, exposed
from calibration.cameras.time_pattern import TimePattern
from tams_app.records import Image
from tams_app.runtime.clock import NS_PER_S

_SKIN = (120, 150, 205)  # BGR
_BOARD_PX_PER_MM = 5.0
_SCREEN_M = 0.52  # wide
_MODULE_PX = 12
_POSE_S = 0.4  # how long the board is held still
_RING_S = 9.0
_START_BLUR_PX = 4.0
_SWITCH_S = (0.8, 1.4)  # between two switchings: nobody keeps a camera's time
_SWITCHINGS = 100
_LIGHT_OFF = 0.35  # what other lamps leave
_POSE_SEED = 0xB0A2D
_SWITCH_SEED = 0x116


class SimulatedPerson:
    """Does what was asked last, and knows when it is finished; all of it in virtual time."""

    def __init__(
        self, lenses: dict[str, Lens], sharpest_px: dict[str, float], board: Board
    ) -> None:
        """By view: the lenses, and the blur that is left when the ring stands right."""
        self._lenses, self._sharpest_px, self._board = lenses, sharpest_px, board
        self._blur_px = dict.fromkeys(lenses, _START_BLUR_PX)
        self._task, self._view, self._since_ns = Task.REST, "", 0
        self._pattern = TimePattern(_MODULE_PX)
        random = np.random.default_rng(_SWITCH_SEED)
        self._switchings_s = np.cumsum(random.uniform(*_SWITCH_S, _SWITCHINGS))
        self._board_image = board.image(_BOARD_PX_PER_MM)
        self._windows: dict[tuple[str, str, int], Window] = {}

    def ask(self, task: Task, view: str, now_ns: int) -> None:
        """Begin to do it for `view`, "" for all."""
        self._task, self._view, self._since_ns = task, view, now_ns

    def finished(self, now_ns: int) -> bool:
        """Whether what was asked is done; what has no end of its own never is."""
        after_s = (now_ns - self._since_ns) / NS_PER_S
        return self._task is Task.FOCUS and after_s >= _RING_S

    def seen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, screen: ScreenTimes | None
    ) -> Image:
        """What `view` sees in an exposure from `start_ns` to `end_ns`, `scene` behind it."""
        middle_s = ((start_ns + end_ns) / 2 - self._since_ns) / NS_PER_S
        meant = self._view in ("", view)
        image = scene
        if self._task is Task.WAVE:
            image = self._hand(scene, middle_s, 1.0 if meant else 0.12)
        elif self._task is Task.SHOW_SCREEN and meant and screen is not None:
            image = self._filmed_screen(view, scene, start_ns, end_ns, screen)
        elif self._task is Task.SWITCH_LIGHT:
            image = self._lit(scene, start_ns, end_ns)
        elif self._task is Task.SHOW_BOARD and meant:
            number = int(middle_s / _POSE_S)
            window = self._window_on_board(view, number)
            image = window.see(self._board_image, scene)
        elif self._task is Task.FOCUS and view == self._view:
            self._blur_px[view] = self._ring(view, middle_s)
        return _blurred(image, self._blur_px[view])

    def _ring(self, view: str, after_s: float) -> float:
        """Turned through the best place to the other end, and back to where the bar was highest."""
        best = self._sharpest_px[view]
        if after_s < _RING_S / 3:
            return best + (_START_BLUR_PX - best) * (1 - 3 * after_s / _RING_S)
        if after_s < 2 * _RING_S / 3:
            return best + 2.0 * math.sin(math.pi * (3 * after_s / _RING_S - 1))
        return best

    def _hand(self, scene: Image, after_s: float, size: float) -> Image:
        height, width = scene.shape[:2]
        image = scene.copy()
        centre = (
            int(width * (0.5 + 0.25 * math.sin(7.0 * after_s))),
            int(height * (0.5 + 0.1 * math.cos(5.0 * after_s))),
        )
        axes = (max(3, int(0.2 * size * width)), max(3, int(0.3 * size * height)))
        cv2.ellipse(image, centre, axes, 15 * math.sin(6 * after_s), 0, 360, _SKIN, -1)
        return image

    def _lit(self, scene: Image, start_ns: int, end_ns: int) -> Image:
        fine = np.linspace(start_ns, end_ns, 20) - self._since_ns
        on = np.searchsorted(self._switchings_s, fine / NS_PER_S) % 2 == 0
        share = float(on.mean())
        return np.asarray(cv2.convertScaleAbs(scene, alpha=_mix(share) ** (1 / GAMMA)), np.uint8)

    def _filmed_screen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, screen: ScreenTimes
    ) -> Image:
        """The screen's light adds up over all refreshes that the exposure saw."""
        first = (start_ns - screen.start_ns) // screen.period_ns
        last = (end_ns - 1 - screen.start_ns) // screen.period_ns
        shares, images = [], []
        for count in range(first, last + 1):
            lit_from = screen.start_ns + count * screen.period_ns
            part_ns = min(end_ns, lit_from + screen.period_ns) - max(start_ns, lit_from)
            shares.append(part_ns / (end_ns - start_ns))
            images.append(self._pattern.draw(count))
        return self._window_on_screen(view).see(exposed(images, shares), scene)

    def _window_on_screen(self, view: str) -> Window:
        lens = self._lenses[view]
        width, height = self._pattern.size
        distance = lens.matrix[0, 0] * _SCREEN_M / (0.6 * lens.size[0])
        turn = Rotation.from_euler("xyz", (9.0, -14.0, 3.0), degrees=True)
        place = Placed(
            np.array([0.01, -0.01, distance]), turn, _SCREEN_M, _SCREEN_M * height / width
        )
        return self._window(("screen", view, 0), lens, place, width / _SCREEN_M, (height, width))

    def _window_on_board(self, view: str, number: int) -> Window:
        lens = self._lenses[view]
        width, height = (part / 1000 for part in self._board.size_mm)
        place = next_pose(lens, width, height, number)
        return self._window(
            ("board", view, number),
            lens,
            place,
            _BOARD_PX_PER_MM * 1000,
            self._board_image.shape[:2],
        )

    def _window(
        self,
        key: tuple[str, str, int],
        lens: Lens,
        place: Placed,
        px_per_m: float,
        shape: tuple[int, ...],
    ) -> Window:
        if key not in self._windows:
            if key[0] == "board":
                self._windows = {k: w for k, w in self._windows.items() if k[0] != "board"}
            self._windows[key] = lens.window_on(place, px_per_m, (shape[0], shape[1]))
        return self._windows[key]


def next_pose(lens: Lens, width_m: float, height_m: float, number: int) -> Placed:
    """Pose `number` of a board shown everywhere in the image, tilted to all sides."""
    random = np.random.default_rng([_POSE_SEED, number])
    columns, rows = 3, 3
    column, row = number % columns, number // columns % rows
    share = random.uniform(0.45, 0.75)  # of the image's width
    distance = lens.matrix[0, 0] * width_m / (share * lens.size[0])
    room_x = lens.size[0] / lens.matrix[0, 0] * distance / 2 - 0.35 * width_m
    room_y = lens.size[1] / lens.matrix[1, 1] * distance / 2 - 0.35 * height_m
    centre = np.array([(column - 1) * room_x, (row - 1) * room_y, distance])
    tilt = np.radians(random.uniform(20, 38))
    side = 2 * np.pi * (number % 4) / 4 + random.uniform(-0.3, 0.3)
    axis = np.array([np.sin(side), np.cos(side), 0.0])
    turn = Rotation.from_rotvec(tilt * axis) * Rotation.from_euler(
        "z", random.uniform(-20, 20), degrees=True
    )
    return Placed(centre, turn, width_m, height_m)


def _mix(share: float) -> float:
    """Light of the scene when the lamp was on for this share of the exposure."""
    return _LIGHT_OFF + (1 - _LIGHT_OFF) * share


def _blurred(image: Image, blur_px: float) -> Image:
    if blur_px < 0.3:
        return image.copy()
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px), np.uint8)

"""A person who does at the cameras what `calibrate cameras` asks for, and how that looks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.cameras.bench import Task
from calibration.cameras.board import MODULES, Board, Points
from tams_app.prediction.plane_warp import corners_of, inverse, mounted, silhouette
from tams_app.records import ArmFigure, Image, Lens, Pose, Vector
from tams_app.rotation import Rotation
from tams_app.session.lenses import BASE
from tams_app.units import NS_PER_S

_SKIN = (120, 150, 205)  # BGR
_SCREEN_BLACK, _SCREEN_WHITE = 25.0, 215.0  # grey levels of the screen in an image
_GAMMA = 2.2
_MODULE_PX = 20
_PAPER, _INK = 235.0, 25.0  # grey levels in an image
_FINER = 3  # the board is drawn so much finer than the picture, and averaged
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


class BoardPainter:
    """Draws the board into the pictures of one camera, as its lens has it."""

    def __init__(self, lens: Lens, ideal: Lens) -> None:
        """`ideal`: without distortion, as the scene is rendered."""
        x, y = np.meshgrid(np.arange(lens.width, dtype=float), np.arange(lens.height, dtype=float))
        slopes = lens.slopes(np.stack((x, y), axis=-1).reshape(-1, 2))
        self._scene_map = _map(ideal.pixels(slopes), lens)
        self._is_bent = lens.is_distorted
        focal, least = _FINER * lens.fx, slopes.min(axis=0)
        corner = -least * focal + _FINER
        self._matrix = np.array([(focal, 0, corner[0]), (0, focal, corner[1]), (0, 0, 1.0)])
        self._map = _map(slopes * focal + corner, lens)
        width, height = np.ceil(slopes.max(axis=0) * focal + corner + _FINER).astype(int).tolist()
        self._size = int(width), int(height)

    def scene(self, rendered: Image) -> Image:
        """A picture without distortion, as this lens makes it."""
        if not self._is_bent:
            return rendered
        bent = cv2.remap(
            rendered, *self._scene_map, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(bent, np.uint8)

    def paint(
        self, scene: Image, board: Board, pose: Pose, hidden: NDArray[np.bool_] | None
    ) -> Image:
        """`scene`, BGR, with the board at `pose` in the camera's frame; not where it is hidden."""
        pattern = board.pattern(_MODULE_PX)
        margin = MODULES * _MODULE_PX
        paper = cv2.copyMakeBorder(
            pattern, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=255
        )
        inked = _INK + np.asarray(paper, np.float32) * ((_PAPER - _INK) / 255.0)
        metre = board.square_m / margin  # a pixel of the pattern
        start = (0.5 - margin) * metre
        axes = pose.rotation.as_matrix()
        plane = np.column_stack(
            (axes[:, 0] * metre, axes[:, 1] * metre, pose.position + axes[:, :2] @ (start, start))
        )
        homography = self._matrix @ plane
        drawn, cover = (
            cv2.remap(
                cv2.blur(cv2.warpPerspective(one, homography, self._size), (_FINER, _FINER)),
                *self._map,
                cv2.INTER_LINEAR,
            )
            for one in (inked, np.ones_like(inked))
        )
        share = np.asarray(cover)[..., None]
        painted = np.rint(scene * (1.0 - share) + np.asarray(drawn)[..., None]).astype(np.uint8)
        if hidden is not None:
            painted[hidden] = scene[hidden]
        return painted


def _map(pixels: Points, lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    both = pixels.reshape(lens.height, lens.width, 2).astype(np.float32)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])


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

    def hidden(self, view: str, now_ns: int) -> NDArray[np.bool_] | None:
        """Where the arm is before the board; None: nowhere."""
        if self._task not in (Task.MOVE_ARM, Task.MOVE_BOARD):
            return None
        joints, lens = self.joints(now_ns), self._lenses[view]
        camera, links = self._camera(view, joints), self._figure.place(joints)
        ahead = camera.rotation.as_matrix()[:, 2]
        middle = self._middle(self._places[self._at])
        board_depth = float((middle - camera.position) @ ahead)
        before = []
        for link, solids in self._figure.solids.items():
            frame = links.get(link, Pose(np.zeros(3), Rotation.identity()))
            for solid in solids:
                place = mounted(frame, solid.pose)
                if 0.0 < float((place.position - camera.position) @ ahead) < board_depth:
                    seen = replace(solid, pose=mounted(inverse(camera), place))
                    before.append(corners_of(seen))
        straight_ahead = replace(lens, pose=Pose(np.zeros(3), Rotation.identity()))
        return silhouette(before, straight_ahead) > 0

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

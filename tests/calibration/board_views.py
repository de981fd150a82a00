"""Views of the board as a lens has them, without pictures: corners with noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.cameras.board import Board, BoardView
from calibration.cameras.fit import ArmView, PlacedBoard
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation

CORNERS = Board().corners
MIDDLE = np.array([*Board().size_m, 0.0]) / 2.0
NOWHERE = Pose(np.zeros(3), Rotation.identity())
LENS = Lens("camera", NOWHERE, 612.0, 609.0, 331.0, 236.0, 640, 480,
            (-0.21, 0.06, 0.001, -0.0007, 0.0))  # fmt: skip


def view_of(lens: Lens, board: Pose, random: np.random.Generator, noise_px: float) -> BoardView:
    """What the camera sees of a board at `board` in its frame."""
    seen = board.position + board.rotation.apply(CORNERS)
    pixels = lens.pixels(seen[:, :2] / seen[:, 2:])
    inside = ((pixels >= 0.0) & (pixels < (lens.width, lens.height))).all(axis=1)
    inside &= seen[:, 2] > 0.0
    noisy = pixels + random.normal(0.0, noise_px, pixels.shape)
    return BoardView(np.flatnonzero(inside).astype(np.int32), CORNERS[inside], noisy[inside])


def held(lens: Lens, column: float, row: float, turn: tuple[float, float, float]) -> Pose:
    """A board whose middle is at a share of the picture, as wide as half of it."""
    distance = 2.0 * lens.fx * Board().size_m[0] / lens.width
    slope = lens.slopes(np.array([(column * lens.width, row * lens.height)]))[0]
    rotation = Rotation.from_rotvec(turn)
    middle = np.array([*slope, 1.0]) * distance
    return Pose(middle - rotation.apply(MIDDLE), rotation)


def shown(
    lens: Lens, number: int, seed: int, noise_px: float = 0.1, tilt: float = 0.6
) -> list[BoardView]:
    """Views from many sides, over all of the picture."""
    random = np.random.default_rng(seed)
    views = []
    for one in range(number):
        column, row = ((one % 3) * 0.3 + 0.2, (one // 3 % 3) * 0.3 + 0.2)
        x, y, z = random.uniform(-tilt, tilt, 3).tolist()
        views.append(view_of(lens, held(lens, column, row, (x, y, z)), random, noise_px))
    return [view for view in views if len(view.ids) >= 8]


MOUNT = Pose(np.array([-0.068, 0.004, 0.024]), Rotation.from_rotvec((0.4, 0.45, 1.5)))
GT = Pose(np.array([0.75, 0.0, 0.82]), Rotation.from_rotvec((2.2, -2.2, 0.5)))
BOARD = Pose(np.array([0.36, -0.02, 0.03]), Rotation.from_rotvec((2.8, 0.3, 0.1)))


def arm_views(
    lens: Lens, mount: Pose, number: int, random: np.random.Generator, noise_px: float = 0.1,
    about: tuple[float, float, float] = (0.5, 0.5, 0.7), joint_noise: float = 0.0,
) -> Iterator[ArmView]:  # fmt: skip
    """The board as a camera on the arm sees it; `about`: turns of the camera about its axes."""
    for _ in range(number):
        x, y, z = (random.uniform(-1.0, 1.0, 3) * about).tolist()
        column, row = random.uniform(0.4, 0.6, 2).tolist()
        camera = mounted(BOARD, inverse(held(lens, column, row, (x, y, z))))
        flange = mounted(camera, inverse(mount))
        told = Pose(
            flange.position + random.normal(0.0, joint_noise, 3),
            flange.rotation * Rotation.from_rotvec(random.normal(0.0, 2 * joint_noise, 3).tolist()),
        )
        yield ArmView(told, view_of(lens, mounted(inverse(camera), BOARD), random, noise_px))


def placed_views(random: np.random.Generator, noise_px: float = 0.1) -> Iterator[PlacedBoard]:
    """The board at five places before a camera that stands at `GT`."""
    for _ in range(5):
        x, y, z = random.uniform(-0.5, 0.5, 3).tolist()
        column, row = random.uniform(0.3, 0.7, 2).tolist()
        board = held(LENS, column, row, (x, y, z))
        view = view_of(LENS, board, random, noise_px)
        in_base = mounted(GT, board)
        yield PlacedBoard(in_base.position + in_base.rotation.apply(view.points), view)

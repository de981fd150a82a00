"""The ChArUco board: where its corners are in a picture, how it is printed, and how it looks.

A chessboard whose white squares carry markers: each corner is known by its number, so that parts of
the board will do, and the edges of a picture can be reached.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import cairo
import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.outputs import refuse_existing, write_file
from tams_app.records import Image, Lens, Pose
from tams_app.rotation import Rotation

COLUMNS, ROWS = 5, 7
SQUARE_MM = 36.0  # on A4, with a margin that printers leave white
MODULES = 8  # of a square's side; of a marker's 6
FEWEST_CORNERS = 8
_PAPER_MM = (210.0, 297.0)
_MM_TO_PT = 72.0 / 25.4
_RULER_MM = 100.0
_DICTIONARY = cv2.aruco.DICT_4X4_50
_FIRST_MARKER = 30  # lower ones lie on many tables, and a second of a number spoils the board

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoardView:
    """Corners of the board, each as it was seen.

    ids: their numbers, shape (n,). points: in the board's frame [m], shape (n, 3): x to the right,
    y down, from its top left. pixels: shape (n, 2).
    """

    ids: NDArray[np.int32]
    points: Points
    pixels: Points

    def moved_px(self, before: BoardView) -> float | None:
        """How far the corners seen in both are apart in the mean; None: too few are in both."""
        _, ours, theirs = np.intersect1d(self.ids, before.ids, return_indices=True)
        if len(ours) < FEWEST_CORNERS // 2:
            return None
        apart = self.pixels[ours] - before.pixels[theirs]
        return float(np.linalg.norm(apart, axis=1).mean())


class Board:
    """The board as it was printed: `square_mm` is what a person measures on it.

    corners: where squares meet, in its own frame [m], shape (24, 3).
    """

    def __init__(self, square_mm: float = SQUARE_MM) -> None:
        self.square_m = square_mm / 1000.0
        marker_m = self.square_m * (MODULES - 2) / MODULES
        dictionary = cv2.aruco.getPredefinedDictionary(_DICTIONARY)
        markers = _FIRST_MARKER + np.arange(COLUMNS * ROWS // 2)
        self._board = cv2.aruco.CharucoBoard(
            (COLUMNS, ROWS), self.square_m, marker_m, dictionary, markers
        )
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self.corners = np.asarray(self._board.getChessboardCorners(), np.float64)

    @property
    def size_m(self) -> tuple[float, float]:
        """Its width and height, without the paper's margin."""
        return COLUMNS * self.square_m, ROWS * self.square_m

    def pattern(self, module_px: int = 1) -> Image:
        """The board from its top left, grey, one module `module_px` wide."""
        size = COLUMNS * MODULES * module_px, ROWS * MODULES * module_px
        return np.asarray(self._board.generateImage(size, marginSize=0, borderBits=1), np.uint8)

    def find(self, image: Image) -> BoardView | None:
        """The corners that are in `image`, grey or BGR; None where too few are, or all in a row."""
        pixels, ids, _, _ = self._detector.detectBoard(image)
        if ids is None or len(ids) < FEWEST_CORNERS:
            return None
        points = self.corners[ids[:, 0]]
        if np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=self.square_m / 2) < 2:
            return None
        numbers = np.asarray(ids[:, 0], np.int32)
        return BoardView(numbers, points, np.asarray(pixels[:, 0], np.float64))


def board_pose(view: BoardView, matrix: Points, distortion: Points) -> Pose:
    """Where the board is in the camera's frame, for OpenCV's intrinsics."""
    _, turns, ways, _ = cv2.solvePnPGeneric(
        view.points, view.pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    turn, way = cv2.solvePnPRefineLM(
        view.points, view.pixels, matrix, distortion, turns[0], ways[0]
    )
    return Pose(np.asarray(way, np.float64).ravel(), Rotation.from_rotvec(turn.ravel().tolist()))


def print_board(path: Path) -> None:
    """Write an A4 page in true scale, PDF; ConfigError if there is something at `path` already."""
    refuse_existing(path)
    page = io.BytesIO()
    width, height = (side * _MM_TO_PT for side in _PAPER_MM)
    with cairo.PDFSurface(page, width, height) as surface:
        _draw(cairo.Context(surface))
    write_file(path, page.getvalue())


def _draw(context: cairo.Context[cairo.PDFSurface]) -> None:
    pattern, module_mm = Board().pattern(), SQUARE_MM / MODULES
    context.scale(_MM_TO_PT, _MM_TO_PT)
    rows, columns = pattern.shape
    left, top = (_PAPER_MM[0] - columns * module_mm) / 2, (_PAPER_MM[1] - rows * module_mm) / 2
    for row, column in np.argwhere(pattern == 0).tolist():
        context.rectangle(left + column * module_mm, top + row * module_mm, module_mm, module_mm)
    context.fill()  # all at once: no seams between modules
    below = _PAPER_MM[1] - top / 2
    context.rectangle(left, below, _RULER_MM, 0.3)
    context.rectangle(left, below - 2, 0.3, 4)
    context.rectangle(left + _RULER_MM - 0.3, below - 2, 0.3, 4)
    context.fill()
    context.set_font_size(3.2)
    context.move_to(left + _RULER_MM + 3, below + 1)
    context.show_text("100 mm. Print at 100 %, glue it flat,")
    context.move_to(left + _RULER_MM + 3, below + 5)
    context.show_text("measure a square: --square-mm")


# --- in simulated pictures ------------------------------------------------------------------------

_MODULE_PX = 20
_PAPER, _INK = 235.0, 25.0  # grey levels in an image
_FINER = 3  # the board is drawn so much finer than the picture, and averaged


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

    def paint(self, scene: Image, board: Board, pose: Pose) -> Image:
        """`scene`, BGR, with the board at `pose` in the camera's frame before all else."""
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
        painted = scene * (1.0 - share) + np.asarray(drawn)[..., None]
        return np.asarray(np.rint(painted), np.uint8)


def _map(pixels: Points, lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    both = pixels.reshape(lens.height, lens.width, 2).astype(np.float32)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1])

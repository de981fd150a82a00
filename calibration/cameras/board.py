"""The ChArUco board: drawn to be printed, and found in images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tams_app.errors import ConfigError
from tams_app.records import Image

_MM_PER_INCH = 25.4
_PAGE_MM = (297.0, 210.0)  # A4, landscape
_DPI = 300
_PX_PER_MM = 10.0
FEWEST_CORNERS = 8

Points = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard of `columns` by `rows` squares with a marker in every white one."""

    columns: int = 9
    rows: int = 6
    square_mm: float = 28.0
    marker_share: float = 0.75  # of the square's edge

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the squares together."""
        return self.columns * self.square_mm, self.rows * self.square_mm

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's; its points are in metres."""
        square_m = self.square_mm / 1000
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), square_m, square_m * self.marker_share, dictionary
        )

    def image(self, pixels_per_mm: float) -> Image:
        """The board without margin, BGR."""
        width, height = (round(part * pixels_per_mm) for part in self.size_mm)
        grey = self.charuco().generateImage((width, height), marginSize=0, borderBits=1)
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


@dataclass(frozen=True, slots=True)
class BoardView:
    """The board's corners in one image: where they are on it and in the image."""

    object_points: Points  # [m], shape (n, 1, 3)
    image_points: Points  # [px], shape (n, 1, 2)


class BoardFinder:
    """Finds the corners of a board to a fraction of a pixel."""

    def __init__(self, board: Board) -> None:
        self._board = board.charuco()
        self._detector = cv2.aruco.CharucoDetector(self._board)

    def find(self, image: Image) -> BoardView | None:
        """The corners in a BGR image; None if fewer than `FEWEST_CORNERS` are seen."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        corners: Any  # OpenCV's stubs want a list; it takes the array
        corners, ids, _, _ = self._detector.detectBoard(grey)
        if ids is None or len(ids) < FEWEST_CORNERS:
            return None
        on_board, in_image = self._board.matchImagePoints(corners, ids)
        if np.linalg.matrix_rank(on_board[:, 0, :2] - on_board[0, 0, :2]) < 2:
            return None  # all on one line
        return BoardView(np.asarray(on_board), np.asarray(in_image))


def print_board(board: Board, path: Path) -> None:
    """Write an A4 page, as PDF or as PNG at 300 dpi; ConfigError if it fits no page or no format.

    A line of 100 mm beside it shows whether the printer kept the size.
    """
    if path.suffix.lower() not in (".pdf", ".png"):
        raise ConfigError(f"{path}: a board is printed to .pdf or .png")
    width, height = board.size_mm
    if width > _PAGE_MM[0] - 16 or height > _PAGE_MM[1] - 30:
        raise ConfigError(
            f"a board of {width:g} x {height:g} mm does not fit on A4; give a smaller --square-mm"
        )
    figure = Figure(figsize=(_PAGE_MM[0] / _MM_PER_INCH, _PAGE_MM[1] / _MM_PER_INCH))
    FigureCanvasAgg(figure)
    left, bottom = (_PAGE_MM[0] - width) / 2, (_PAGE_MM[1] - height) / 2 + 6
    axes = figure.add_axes(
        (left / _PAGE_MM[0], bottom / _PAGE_MM[1], width / _PAGE_MM[0], height / _PAGE_MM[1])
    )
    axes.imshow(board.image(_PX_PER_MM), interpolation="nearest", aspect="auto")
    axes.set_axis_off()
    page = figure.add_axes((0, 0, 1, 1), facecolor="none", zorder=-1)
    page.set_xlim(0, _PAGE_MM[0])
    page.set_ylim(0, _PAGE_MM[1])
    page.set_axis_off()
    page.plot([left, left + 100], [10, 10], color="black", linewidth=1, marker="|")
    page.text(
        left + 104,
        10,
        f"100 mm: measure it. {board.columns} x {board.rows} squares of {board.square_mm:g} mm, "
        "ArUco 5x5_100. Print at 100 %, glue it to something flat.",
        fontsize=8,
        va="center",
    )
    try:
        figure.savefig(path, dpi=_DPI)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error

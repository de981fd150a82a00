"""Which views of the board are taken: it holds still, and it is seen otherwise than before."""

from __future__ import annotations

from itertools import product

import numpy as np

from calibration.cameras.board import BoardView

_STILL_PX = 1.0  # of a picture 640 wide, between two frames
_OTHERWISE = 0.06  # of the picture's width
_FULL_PX = 640
_EDGE = 0.2  # of a side: as near to it corners have to come
_ROWS, _COLUMNS = ("top", "", "bottom"), ("left", "", "right")
WANTED_VIEWS = 20


class Still:
    """Tells of one camera's views of the board whether it held still since the view before."""

    def __init__(self, width: int) -> None:
        self._bound_px = _STILL_PX * max(1.0, width / _FULL_PX)
        self._before: BoardView | None = None

    def holds(self, view: BoardView | None) -> bool:
        """Whether `view`, the newest, is where the one before was; None: not seen."""
        before, self._before = self._before, view
        if view is None or before is None:
            return False
        moved_px = view.moved_px(before)
        return moved_px is not None and moved_px < self._bound_px


class ViewTaker:
    """Collects views of the board for a lens: from many sides, up to the edges of the picture."""

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._still = Still(width)
        self.views: list[BoardView] = []
        self._covered: set[tuple[int, int]] = set()

    def offer(self, view: BoardView | None) -> str:
        """What becomes of the newest view, in a word or two for the person."""
        if not self._still.holds(view):
            return "no board" if view is None else "hold still"
        assert view is not None
        if any(self._is_near(view, taken) for taken in self.views):
            return "taken; now another side"
        self.views.append(view)
        self._covered |= set(map(self._region, view.pixels))
        return "taken"

    @property
    def open_edges(self) -> list[str]:
        """The parts of the picture's edge that no corner came near to."""
        return [
            f"{_ROWS[row]} {_COLUMNS[column]}".strip()
            for row, column in product(range(3), range(3))
            if (row, column) not in self._covered and (row, column) != (1, 1)
        ]

    @property
    def is_complete(self) -> bool:
        """Whether nothing is wanted any more."""
        return len(self.views) >= WANTED_VIEWS and not self.open_edges

    def _is_near(self, view: BoardView, taken: BoardView) -> bool:
        moved_px = view.moved_px(taken)
        return moved_px is not None and moved_px < _OTHERWISE * self._width

    def _region(self, pixel: np.ndarray) -> tuple[int, int]:
        """Row and column of nine parts of the picture: the edges' are a fifth of it wide."""
        across, down = pixel[0] / self._width, pixel[1] / self._height
        return _third(down), _third(across)


def _third(share: float) -> int:
    return 0 if share < _EDGE else 2 if share > 1.0 - _EDGE else 1

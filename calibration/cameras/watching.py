"""Watching the board: which views of it are taken, and where board and arm rest."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product

import numpy as np
from rich.text import Text

from calibration.cameras.bench import Bench, Task, agreed, until_done
from calibration.cameras.board import Board, BoardView
from calibration.cameras.fit import (
    ArmView,
    HandEye,
    MountFit,
    NoFitError,
    PlacedBoard,
    board_in_camera,
    fit_fixed,
    fit_hand_eye,
    turns_problem,
)
from calibration.kit import WizardUI
from tams_app.prediction.plane_warp import mounted
from tams_app.records import ArmFigure, Frame, Lens, Pose
from tams_app.session.lenses import WRIST_VIEW

EVERY = 5  # frames: corners cost tens of milliseconds each
_MOVING_S, _PLACING_S = 900.0, 180.0
_AT_REST_M, _AT_REST_DEG = 0.0005, 0.05
_NEW_POSE_M, _NEW_POSE_DEG = 0.02, 6.0  # of the flange
_NEW_PLACE_M, _NEW_PLACE_DEG = 0.03, 8.0  # of the board

_STILL_PX, _STILL_WIDTH_PX = 1.0, 640  # between two frames, of pictures so wide
_NEW_VIEW_SHARE = 0.06  # of the picture's width, the corners' mean
_EDGE_SHARE = 0.2  # of a side: as near to it corners have to come
_ROWS, _COLUMNS = ("top", "", "bottom"), ("left", "", "right")
WANTED_VIEWS = 20
WANTED_POSES, WANTED_PLACES = 16, 5
_MOST_PLACES = 8  # that a simulated person tries

Place = tuple[Pose, dict[str, BoardView]]
"""Where the board is (base frame), and what each camera beside the arm saw of it."""


class Still:
    """Whether the board holds still before one camera, by each view and the one before it."""

    def __init__(self, width: int) -> None:
        self._bound_px = _STILL_PX * max(1.0, width / _STILL_WIDTH_PX)
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
        return moved_px is not None and moved_px < _NEW_VIEW_SHARE * self._width

    def _region(self, pixel: np.ndarray) -> tuple[int, int]:
        """Row and column of nine parts of the picture: the edges' are a fifth of it wide."""
        across, down = pixel[0] / self._width, pixel[1] / self._height
        return _third(down), _third(across)


def _third(share: float) -> int:
    return 0 if share < _EDGE_SHARE else 2 if share > 1.0 - _EDGE_SHARE else 1


class Watcher:
    """Watches the cameras of `lenses`, by view, and the arm that the one of WRIST_VIEW is on."""

    def __init__(
        self,
        ui: WizardUI,
        bench: Bench,
        board: Board,
        cameras: Mapping[str, str],
        lenses: Mapping[str, Lens],
        figure: ArmFigure,
    ) -> None:
        """`cameras`: by view, as the bench calls them."""
        self._ui, self._bench, self._board = ui, bench, board
        self._views = {cameras[view]: view for view in lenses}
        self._lenses, self._figure = lenses, figure
        self._still = {view: Still(bench.width) for view in lenses}
        self._rested: Pose | None = None  # the flange, when the camera on the arm saw it last
        self._seen: dict[str, BoardView] = {}  # by view, while it holds still
        self._beside: dict[str, BoardView] = {}  # what the others saw last, since `poses` began

    def mount_on_arm(self) -> HandEye | None:
        """The mount of the camera on the arm; None if it was not found."""
        ui, bench, view = self._ui, self._bench, WRIST_VIEW.upper()
        while True:
            ui.print(
                f"{view}: lay the board on the table, propped up towards the other cameras, and "
                f"leave it there. Move the arm, by hand or by its own program, to {WANTED_POSES} "
                f"poses from which {view} sees the board: from all sides, turned about the "
                "camera's axis by 30° and more, and tilted. Let it rest each time; it is taken by "
                "itself. Enter ends it."
            )
            bench.prompt(Task.MOVE_ARM, WRIST_VIEW)
            try:
                found = fit_hand_eye(self._lenses[WRIST_VIEW], self._poses(WANTED_POSES))
            except NoFitError as error:
                ui.print(f"{view}: no mount: {error}.")
                if not agreed(ui, bench, "Try again?"):
                    return None
            else:
                ui.print(f"{view}: {mount_words(found.mount)}.")
                return found

    def mounts_beside(self, hand_eye: HandEye) -> dict[str, MountFit]:
        """The mounts of the other cameras, by view, as far as they were found."""
        ui, bench = self._ui, self._bench
        views = [view for view in self._lenses if view != WRIST_VIEW]
        if not views:
            return {}
        ui.print(
            f"{names_of(views)}: put the board at {WANTED_PLACES - 1} other places, tilted "
            f"otherwise each time, where {WRIST_VIEW.upper()} and all of them see it, and let "
            "board and arm rest. Enter takes a place that not all of them see; Enter where none "
            "does ends it."
        )
        places: list[Place] = [(hand_eye.board, dict(self._beside))]
        for _ in range(_MOST_PLACES):
            bench.prompt(Task.MOVE_BOARD, "")
            place = self._next_place(hand_eye.mount.pose, [board for board, _ in places])
            if place is not None:
                places.append(place)
                ui.print(f"Place {len(places)} of {WANTED_PLACES}: seen by {names_of(place[1])}.")
            if len(places) == WANTED_PLACES or (place is None and bench.attended):
                break
        found = {}
        for view in views:
            seen_there = [
                PlacedBoard(board.position + board.rotation.apply(seen[view].points), seen[view])
                for board, seen in places
                if view in seen
            ]
            try:
                found[view] = fit_fixed(self._lenses[view], seen_there)
            except NoFitError as error:
                ui.print(f"{view.upper()}: no mount: {error}.")
            else:
                ui.print(f"{view.upper()}: {mount_words(found[view])}.")
        return found

    def _poses(self, wanted: int) -> list[ArmView]:
        """The board from several poses of the arm, each as both rest; until it is enough."""
        taken: list[ArmView] = []
        self._beside = {}
        state = "no board yet"
        for frame in self._shots(_MOVING_S):
            if self._views[frame.view] != WRIST_VIEW:
                continue
            view = self._seen.get(WRIST_VIEW)
            if self._rested is None:
                state = "the arm sends no reports"
            elif view is None:
                state = "no board, or not at rest"
            elif any(_near(self._rested, one.flange, _NEW_POSE_M, _NEW_POSE_DEG) for one in taken):
                state = "taken; now another pose"
            else:
                taken.append(ArmView(self._rested, view))
                state = "taken"
            self._ui.show(Text(f"{WRIST_VIEW.upper()} {len(taken)} of {wanted} poses; {state}"))
            if len(taken) >= wanted and not turns_problem([one.flange for one in taken]):
                break
        return taken

    def _next_place(self, mount: Pose, before: Sequence[Pose]) -> Place | None:
        """The board at another place than `before`, at rest; None: Enter was pressed without one.

        mount: of the camera on the arm, by which the place is known.
        """
        self._seen = {}
        place = None
        for _ in self._shots(_PLACING_S):
            place = self._place(mount, before)
            seen = names_of(self._seen) or "no camera"
            self._ui.show(Text(f"Seen at rest by {seen}"))
            if place is not None and len(self._seen) == len(self._lenses):
                break
        return place

    def _place(self, mount: Pose, before: Sequence[Pose]) -> Place | None:
        view = self._seen.get(WRIST_VIEW)
        if view is None or self._rested is None or len(self._seen) < 2:
            return None
        camera = mounted(self._rested, mount)
        board = mounted(camera, board_in_camera(self._lenses[WRIST_VIEW], view))
        if any(_near(board, one, _NEW_PLACE_M, _NEW_PLACE_DEG) for one in before):
            return None
        return board, {name: seen for name, seen in self._seen.items() if name != WRIST_VIEW}

    def _shots(self, most_s: float) -> Iterator[Frame]:
        """Each frame, after it was looked at."""
        for frame in until_done(self._ui, self._bench, list(self._views), most_s, EVERY):
            self._look(frame)
            yield frame

    def _look(self, frame: Frame) -> None:
        view = self._views[frame.view]
        seen = self._board.find(frame.image)
        rests = self._still[view].holds(seen)
        if view == WRIST_VIEW:
            joints, before = self._bench.joints(), self._rested
            flange = None if joints is None else self._figure.place(joints)[self._figure.flange]
            self._rested = flange
            rests &= (
                flange is not None
                and before is not None
                and _near(flange, before, _AT_REST_M, _AT_REST_DEG)
            )
        if rests and seen is not None:
            self._seen[view] = seen
            self._beside |= {} if view == WRIST_VIEW else {view: seen}
        else:
            self._seen.pop(view, None)


def _near(one: Pose, other: Pose, metres: float, degrees: float) -> bool:
    apart = float(np.linalg.norm(one.position - other.position))
    turned = float(np.degrees((one.rotation.inv() * other.rotation).magnitude()))
    return apart < metres and turned < degrees


def names_of(views: Iterable[str]) -> str:
    """As they are shown."""
    return ", ".join(view.upper() for view in views)


def mount_words(fit: MountFit) -> str:
    """What was found, with its error."""
    x, y, z = (fit.pose.position * 1000.0).tolist()
    return (
        f"at ({x:.1f}, {y:.1f}, {z:.1f}) mm (± {fit.position_sd_mm:.1f} mm, "
        f"{fit.rotation_sd_deg:.2f}°); where it was not fitted to it predicts the corners within "
        f"{fit.error_px:.1f} px (rms); {fit.views} views"
    )

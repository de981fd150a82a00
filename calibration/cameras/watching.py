"""All cameras and the arm at once: where board and arm rest, and which cameras see it there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from rich.text import Text

from calibration.cameras.bench import Bench, Shot, until_done
from calibration.cameras.board import Board, BoardView
from calibration.cameras.mount_fit import ArmView, board_in_camera, turns_problem
from calibration.cameras.taking import Still
from calibration.ui import WizardUI
from tams_app.prediction.plane_warp import mounted
from tams_app.records import Lens, Pose

_EVERY = 5  # frames: corners cost tens of milliseconds each
_MOVING_S, _PLACING_S = 900.0, 180.0
_RESTS_M, _RESTS_DEG = 0.0005, 0.05
_OTHERWISE_M, _OTHERWISE_DEG = 0.02, 6.0  # of the arm, from one pose to another
_ELSEWHERE_M, _ELSEWHERE_DEG = 0.03, 8.0  # of the board, from one place to another

Place = tuple[Pose, dict[str, BoardView]]
"""Where the board is (base frame), and what each camera beside the arm saw of it."""


class Watcher:
    """Watches the cameras of `lenses`, by view; `wrist` names the one on the arm."""

    def __init__(
        self,
        ui: WizardUI,
        bench: Bench,
        board: Board,
        cameras: Mapping[str, str],
        lenses: Mapping[str, Lens],
        wrist: str,
        flange: Callable[[], Pose | None],
    ) -> None:
        """`cameras`: by view, as the bench calls them. `flange`: where it is; None: not known."""
        self._ui, self._bench, self._board = ui, bench, board
        self._views = {cameras[view]: view for view in lenses}
        self._lenses, self._wrist, self._flange = lenses, wrist, flange
        self._still: dict[str, Still] = {}
        self._rested: Pose | None = None  # the flange, when the camera on the arm saw it last
        self._seen: dict[str, BoardView] = {}  # by view, while it holds still
        self._beside: dict[str, BoardView] = {}  # what the others saw last, since `poses` began

    def poses(self, wanted: int) -> list[ArmView]:
        """The board from several poses of the arm, each as both rest; until it is enough."""
        taken: list[ArmView] = []
        self._beside = {}
        said = "no board yet"
        for shot in self._shots(_MOVING_S):
            if self._views[shot.camera] != self._wrist:
                continue
            view = self._seen.get(self._wrist)
            if self._rested is None:
                said = "nothing is heard of the arm"
            elif view is None:
                said = "no board, or not at rest"
            elif any(
                _near(self._rested, one.flange, _OTHERWISE_M, _OTHERWISE_DEG) for one in taken
            ):
                said = "taken; now another pose"
            else:
                taken.append(ArmView(self._rested, view))
                said = "taken"
            self._ui.show(Text(f"{self._wrist.upper()} {len(taken)} of {wanted} poses; {said}"))
            if len(taken) >= wanted and not turns_problem([one.flange for one in taken]):
                break
        return taken

    def first_place(self, board: Pose) -> Place:
        """Where the board lay during `poses`, as the other cameras saw it."""
        return board, dict(self._beside)

    def next_place(self, mount: Pose, before: Sequence[Pose]) -> Place | None:
        """The board at another place than `before`, at rest; None: Enter was pressed without one.

        mount: of the camera on the arm, by which the place is known.
        """
        self._seen = {}
        place = None
        for _ in self._shots(_PLACING_S):
            place = self._place(mount, before)
            seen = ", ".join(view.upper() for view in self._seen) or "no camera"
            self._ui.show(Text(f"Seen at rest by {seen}"))
            if place is not None and len(self._seen) == len(self._lenses):
                break
        return place

    def _place(self, mount: Pose, before: Sequence[Pose]) -> Place | None:
        view = self._seen.get(self._wrist)
        if view is None or self._rested is None or len(self._seen) < 2:
            return None
        camera = mounted(self._rested, mount)
        board = mounted(camera, board_in_camera(self._lenses[self._wrist], view))
        if any(_near(board, one, _ELSEWHERE_M, _ELSEWHERE_DEG) for one in before):
            return None
        return board, {name: seen for name, seen in self._seen.items() if name != self._wrist}

    def _shots(self, most_s: float) -> Iterator[Shot]:
        """Each frame, after it was looked at."""
        for shot in until_done(self._ui, self._bench, list(self._views), most_s, _EVERY):
            self._look(shot)
            yield shot

    def _look(self, shot: Shot) -> None:
        view, image = self._views[shot.camera], shot.frame.image
        if view not in self._still:
            self._still[view] = Still(image.shape[1])
        seen = self._board.find(image)
        rests = self._still[view].holds(seen)
        if view == self._wrist:
            flange, before = self._flange(), self._rested
            self._rested = flange
            rests &= (
                flange is not None
                and before is not None
                and _near(flange, before, _RESTS_M, _RESTS_DEG)
            )
        if rests and seen is not None:
            self._seen[view] = seen
            self._beside |= {} if view == self._wrist else {view: seen}
        else:
            self._seen.pop(view, None)


def _near(one: Pose, other: Pose, metres: float, degrees: float) -> bool:
    apart = float(np.linalg.norm(one.position - other.position))
    turned = float(np.degrees((one.rotation.inv() * other.rotation).magnitude()))
    return apart < metres and turned < degrees

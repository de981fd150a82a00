"""A camera's lens from a board that the person holds before it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from rich.text import Text

from calibration.cameras.asking import until_done
from calibration.cameras.bench import Bench, Task
from calibration.cameras.board import Board, BoardFinder, BoardView
from calibration.cameras.coverage import Coverage
from calibration.cameras.findings import Findings
from calibration.cameras.intrinsics import fit_intrinsics
from calibration.desk import Desk
from tams_app.errors import TamsError

_PATIENCE_S = 180.0
_EVERY = 4  # images: the finder takes some tens of milliseconds
_STILL_PX = 1.5  # between two images looked at


def measure_intrinsics(desk: Desk, bench: Bench, found: Findings, board: Board) -> None:
    """Collect views until they suffice, and fit; what is wrong is said and nothing kept."""
    view = found.view.upper()
    desk.say(
        f"{view}: hold the board before it, still for a moment in each place: everywhere in the "
        "image, near and far, tilted to all four sides. Enter ends it early."
    )
    bench.prompt(Task.SHOW_BOARD, found.view)
    coverage = _collect(desk, bench, found, board)
    wanting = coverage.wanting()
    if wanting:
        desk.say(f"{view}: not enough was shown: {wanting}.")
        return
    try:
        found.intrinsics = fit_intrinsics(coverage.views, bench.width, bench.height)
    except ValueError as error:
        desk.say(f"{view}: no lens found: {error}.")
        return
    lens = found.intrinsics
    listed = ", ".join(
        f"{name} {lens.values[name]:.4g} ± {lens.errors[name]:.2g}" for name in lens.values
    )
    desk.say(
        f"{view}: {listed}; {lens.rms_px:.2f} px reprojection error over "
        f"{len(lens.view_rms_px)} views ({lens.left_out} left out)."
    )


def _collect(desk: Desk, bench: Bench, found: Findings, board: Board) -> Coverage:
    finder, coverage = BoardFinder(board), Coverage(bench.width, bench.height)
    before: BoardView | None = None
    for shot in until_done(desk, bench, [found.camera], _PATIENCE_S, _EVERY):
        seen = finder.find(shot.frame.image)
        if seen is None:
            word = "no board in sight"
        elif not _still(seen, before):
            word = "hold still"
        else:
            word = coverage.offer(seen) or "taken"
        before = seen
        wanting = coverage.wanting()
        desk.show(
            Text(
                f"{found.view.upper()}: {len(coverage.views)} views, {coverage.share:.0%} of the "
                f"image; {word}. {wanting}"
            )
        )
        if not wanting:
            break
    return coverage


def _still(seen: BoardView, before: BoardView | None) -> bool:
    if before is None or seen.image_points.shape != before.image_points.shape:
        return False
    return bool(np.abs(seen.image_points - before.image_points).max() < _STILL_PX)


def file_name(found: Findings, made: str) -> str:
    """Where a lens measured at `made` (UTC) is kept, in the folder of the calibration."""
    return f"intrinsics-{found.view}-{made}.yaml"


def write_intrinsics(found: Findings, board: Board, folder: Path, made: str) -> None:
    """Keep the lens beside the calibration; `made`: UTC time, as in the calibration's name."""
    lens = found.intrinsics
    assert lens is not None
    content = {
        "view": found.view,
        "camera": found.camera,
        "made": made,
        "model": "OpenCV pinhole; fx, fy, cx, cy [px], k1, k2, p1, p2, k3 = 0",
        "width_px": lens.width,
        "height_px": lens.height,
        "values": lens.values,
        "standard_deviations": lens.errors,
        "rms_px": lens.rms_px,
        "views": len(lens.view_rms_px),
        "views_left_out": lens.left_out,
        "board": {
            "columns": board.columns,
            "rows": board.rows,
            "square_mm": board.square_mm,
            "dictionary": "5x5_100",
        },
    }
    path = folder / file_name(found, made)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write("# For those who need it; TAMS itself does not use lenses.\n")
            yaml.safe_dump(content, file, sort_keys=False)
    except OSError as error:
        raise TamsError(f"{path}: cannot be written: {error.strerror}") from error

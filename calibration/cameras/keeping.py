"""From what was found of the cameras to the calibration file, and the lenses beside it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from calibration.cameras import intrinsics_step
from calibration.cameras.bench import Bench
from calibration.cameras.board import Board
from calibration.cameras.findings import Findings
from calibration.desk import Desk
from calibration.store import Calibration, CalibrationSet
from tams_app.config import Config


def keep(
    desk: Desk,
    bench: Bench,
    config: Config,
    store: CalibrationSet,
    found: Sequence[Findings],
    board: Board,
    yes: bool,
) -> int:
    """Propose the calibration, and the lenses beside it; 0 if written or not wanted, else 1."""
    made = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    for each in found:
        if each.intrinsics is not None:
            each.intrinsics_file = intrinsics_step.file_name(each, made)
    changes = {"cameras": {each.view: camera_keys(bench, config, each) for each in found}}
    quality: dict[str, Any] = {each.view: each.quality() for each in found}
    calibration = Calibration("cameras", changes, bench.source, quality, not bench.attended)

    def write_lenses() -> None:
        for each in found:
            if each.intrinsics is not None:
                intrinsics_step.write_intrinsics(each, board, store.folder, made)

    somebody_decides = desk.attended
    written = store.propose(desk, calibration, yes, write_lenses)
    return 0 if written is not None or somebody_decides else 1


def camera_keys(bench: Bench, config: Config, found: Findings) -> dict[str, Any]:
    """All keys of a view's camera that this kind of calibration knows.

    All of them each time: the new file replaces the old one. What was not measured now stays as
    the configuration has it.
    """
    before = config.cameras.get(found.view)
    keys: dict[str, Any] = dict(bench.binding(found.camera))
    if found.settings is not None:
        keys["exposure_us"] = found.settings.exposure_us
        keys["white_balance_k"] = found.settings.white_balance_k
    elif before is not None:
        keys["exposure_us"] = before.exposure_us
        keys["white_balance_k"] = before.white_balance_k
    return keys

"""What a recorded session tells of its cameras."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from calibration.cameras.exposure import exposure_advice, measure_exposure
from calibration.cameras.findings import Findings
from calibration.cameras.focus import focus_advice, sharpness
from calibration.cameras.timing import FEWEST_FRAMES, measure_rate, rate_advice
from calibration.ui import WizardUI
from tams_app.errors import LogError
from tams_app.recording import SessionLog, read_log, read_reference
from tams_app.records import Frame, Image
from tams_app.session.recorders import LOG_NAME, REFERENCE_NAME

_FRAMES = 90  # of each view, for flicker
CANNOT = (
    "A log does not tell which camera is which, nor how long the light takes to its time stamp: "
    "that takes the cameras, or --sim."
)


def findings_of_log(ui: WizardUI, folder: Path) -> list[Findings]:
    """Frame rate and, with `--record-reference`, focus and exposure; all is said.

    LogError if the folder holds no session.
    """
    log = read_log(folder / LOG_NAME)
    references = _reference(folder / REFERENCE_NAME, log)
    views = sorted({record.view for record in log.captured})
    if not views:
        raise LogError(f"{folder}: no camera gave a pixel in this session")
    found = [_one(view, log, references.get(view, [])) for view in views]
    for each in found:
        words = "; ".join(each.advice) if each.advice else "nothing wrong with it"
        rate = f"{each.rate.rate_hz:.2f} Hz, {each.rate.missed} missed, " if each.rate else ""
        ui.say(f"{each.view.upper()}: {rate}{words}.")
    if not references:
        ui.say(
            f"{folder}: has no {REFERENCE_NAME}, so focus and exposure cannot be told: record a "
            "session with --record-reference."
        )
    ui.say(CANNOT)
    return found


def _one(view: str, log: SessionLog, frames: list[Frame]) -> Findings:
    found = Findings(view, f"{view} of the log")
    captured = {record.index: record.capture_ns for record in log.captured if record.view == view}
    if len(captured) >= FEWEST_FRAMES:
        found.rate = measure_rate([captured[index] for index in sorted(captured)])
        found.advice += rate_advice(found.rate, log.header.fps)
    if frames:
        images: list[Image] = [frame.image for frame in frames]
        found.image = images[-1]
        found.sharpness = sharpness(images[-1])
        found.exposure = measure_exposure(images)
        found.advice += [line for line in (focus_advice(found.sharpness),) if line]
        found.advice += exposure_advice(found.exposure, None, log.header.fps, images[-1].shape[1])
    return found


def _reference(path: Path, log: SessionLog) -> dict[str, list[Frame]]:
    """The first images of each view; none without the file."""
    frames: dict[str, list[Frame]] = {}
    if path.is_file():
        views = len({record.view for record in log.captured})
        for frame in islice(read_reference(path, log.header.wall_offset_ns), views * _FRAMES):
            frames.setdefault(frame.view, []).append(frame)
    return frames

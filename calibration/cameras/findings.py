"""What was found out about one view's camera, for the calibration file and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import cv2

from calibration.cameras.bench import Settings
from calibration.cameras.flashes import Latency
from calibration.cameras.image_quality import (
    Exposure,
    Sharpness,
    blur_words,
    exposure_advice,
    focus_advice,
    measure_exposure,
    sharpness,
)
from calibration.cameras.lens_fit import LensFit
from calibration.cameras.mount_fit import MountFit
from calibration.cameras.timing import FEWEST_FRAMES, Rate, measure_rate, rate_advice
from calibration.ui import WizardUI
from tams_app.errors import UnreadableLogError
from tams_app.recording import LOG_NAME, SessionLog, read_log, read_reference
from tams_app.records import Frame, Image
from tams_app.report.plots import WIDE_IN, new_figure, save_figure, styled
from tams_app.session.recorders import REFERENCE_NAME


@dataclass(slots=True)
class Findings:
    """Of one view; None where a step was not done."""

    view: str
    camera: str
    image: Image | None = None
    sharpness: Sharpness | None = None
    exposure: Exposure | None = None
    rate: Rate | None = None
    settings: Settings | None = None  # accepted, to be written
    latency: Latency | None = None
    lens: LensFit | None = None
    mount: MountFit | None = None
    advice: list[str] = field(default_factory=list)

    def quality(self) -> dict[str, Any]:
        """For the calibration file; units in the keys."""
        kept: dict[str, Any] = {"camera": self.camera}
        if self.sharpness is not None:
            kept["edge_blur_px"] = _number(self.sharpness.blur_px)
        if self.exposure is not None:
            kept["mean_grey"] = _number(self.exposure.mean_grey)
            kept["clipped_share"] = _number(self.exposure.too_bright + self.exposure.too_dark)
            kept["flicker_share"] = _number(self.exposure.flicker)
        if self.rate is not None:
            kept["rate_hz"] = _number(self.rate.rate_hz)
            kept["jitter_ms"] = _number(self.rate.jitter_ms)
            kept |= {"missed_frames": self.rate.missed, "frames": self.rate.frames}
        if self.latency is not None:
            kept["latency_ms"] = _number(self.latency.ms)
            kept["latency_error_ms"] = _number(self.latency.error_ms)
        if (lens := self.lens) is not None:
            kept["lens_error_px"] = _number(lens.error_px)
            kept |= {"lens_focal_error": _number(lens.focal_error), "lens_views": lens.views}
        if (mount := self.mount) is not None:
            kept["mount_error_px"] = _number(mount.error_px)
            kept["mount_position_sd_mm"] = _number(mount.position_sd_mm)
            kept["mount_rotation_sd_deg"] = _number(mount.rotation_sd_deg)
            kept["mount_views"] = mount.views
        if self.advice:
            kept["advice"] = list(self.advice)
        return kept

    def lines(self) -> list[str]:
        """What is known, a line each."""
        lines = []
        if self.sharpness is not None:
            lines.append(blur_words(self.sharpness))
        if (seen := self.exposure) is not None:
            flicker = "" if seen.flicker is None else f", flicker {seen.flicker:.1%}"
            lines.append(
                f"mean grey {seen.mean_grey:.0f}, white {seen.too_bright:.1%}, "
                f"black {seen.too_dark:.1%}{flicker}"
            )
        if (rate := self.rate) is not None:
            lines.append(
                f"{rate.rate_hz:.2f} Hz, jitter {rate.jitter_ms:.1f} ms, "
                f"missed {rate.missed} of {rate.frames + rate.missed}"
            )
        if self.latency is not None:
            lines.append(f"latency {self.latency.ms:.0f} ± {self.latency.error_ms:.0f} ms")
        if self.lens is not None:
            lines.append(f"lens {self.lens.lens.fx:.0f} px, within {self.lens.error_px:.2f} px")
        if self.mount is not None:
            lines.append(f"mount within {self.mount.error_px:.1f} px")
        return lines


@styled
def draw_findings(found: Sequence[Findings], path: Path) -> None:
    """The views with what is known of each; TamsError if it cannot be written."""
    lines = max(len(each.lines()) for each in found)
    figure = new_figure(WIDE_IN, 3.0 + 0.16 * lines)
    for axes, each in zip(figure.subplots(1, len(found), squeeze=False)[0], found, strict=True):
        axes.set_title(f"{each.view.upper()}: {each.camera}")
        if each.image is not None:
            axes.imshow(cv2.cvtColor(each.image, cv2.COLOR_BGR2RGB))
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlabel("\n".join(each.lines()), loc="left")
    save_figure(figure, path)


def _number(value: float | None) -> float | None:
    """Four digits are more than any of it is good for; what was not measurable is null."""
    return None if value is None or value != value else float(f"{value:.4g}")


_FRAMES = 90  # of each view, for flicker
CANNOT = (
    "A log does not tell which camera is which, nor lens, mount, and latency of any: "
    "that takes the cameras, or --sim."
)


def findings_of_log(ui: WizardUI, folder: Path) -> list[Findings]:
    """Frame rate and, with `--record-reference`, focus and exposure; all is printed.

    LogError if the folder holds no session.
    """
    log = read_log(folder / LOG_NAME)
    references = _reference(folder / REFERENCE_NAME, log)
    views = sorted({record.view for record in log.captured})
    if not views:
        raise UnreadableLogError(f"{folder}: no camera gave a frame in this session")
    found = [_one(view, log, references.get(view, [])) for view in views]
    for each in found:
        words = "; ".join(each.advice) if each.advice else "nothing wrong with it"
        rate = f"{each.rate.rate_hz:.2f} Hz, {each.rate.missed} missed, " if each.rate else ""
        ui.print(f"{each.view.upper()}: {rate}{words}.")
    if not references:
        ui.print(
            f"{folder}: has no {REFERENCE_NAME}, so focus and exposure cannot be told: record a "
            "session with --record-reference."
        )
    ui.print(CANNOT)
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

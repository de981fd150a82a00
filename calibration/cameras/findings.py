"""What was found out about one view's camera, for the calibration file and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from calibration.cameras.flashes import Latency
from calibration.cameras.lens_fit import LensFit
from calibration.cameras.mount_fit import MountFit
from tams_app.records import Image
from tams_app.report.plots import WIDE_IN, new_figure, save_figure, styled


@dataclass(slots=True)
class Findings:
    """Of one view; None where a step was not done."""

    view: str
    camera: str
    image: Image | None = None
    latency: Latency | None = None
    lens: LensFit | None = None
    mount: MountFit | None = None

    def quality(self) -> dict[str, Any]:
        """For the calibration file; units in the keys."""
        kept: dict[str, Any] = {"camera": self.camera}
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
        return kept

    def lines(self) -> list[str]:
        """What is known, a line each."""
        lines = []
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


def _number(value: float) -> float:
    """Four digits are more than any of it is good for."""
    return float(f"{value:.4g}")

"""What was found out of one view's camera, and what the calibration file keeps of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from calibration.cameras.bench import Settings
from calibration.cameras.common_event import Offset
from calibration.cameras.exposure import Exposure
from calibration.cameras.focus import Sharpness
from calibration.cameras.intrinsics import Intrinsics
from calibration.cameras.latency import Latency
from calibration.cameras.timing import ClockCheck, Rate
from tams_app.records import Image


@dataclass(slots=True)
class Findings:
    """Of one view; None where a step was not done."""

    view: str
    camera: str
    image: Image | None = None
    sharpness: Sharpness | None = None
    exposure: Exposure | None = None
    rate: Rate | None = None
    clock: ClockCheck | None = None
    settings: Settings | None = None  # accepted, to be written
    to_capture: Latency | None = None  # from the light
    to_shown: Latency | None = None  # from the capture
    in_all: Latency | None = None
    offset: Offset | None = None  # of its timestamps against the first view's
    intrinsics: Intrinsics | None = None
    intrinsics_file: str = ""
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
            kept |= {
                "rate_hz": _number(self.rate.rate_hz),
                "jitter_ms": _number(self.rate.jitter_ms),
                "missed_frames": self.rate.missed,
                "frames": self.rate.frames,
            }
        if self.clock is not None:
            kept |= {
                "timestamp_age_ms": _number(self.clock.age_ms),
                "clock_drift_ppm": _number(self.clock.drift_ppm),
                "clock_drift_error_ppm": _number(self.clock.drift_error_ppm),
            }
        for name, latency in (
            ("light_to_capture", self.to_capture),
            ("capture_to_shown", self.to_shown),
            ("light_to_shown", self.in_all),
        ):
            if latency is not None:
                kept[f"{name}_ms"] = _number(latency.median_ms)
                if latency.error_ms:
                    kept[f"{name}_error_ms"] = _number(latency.error_ms)
        if self.offset is not None:
            kept["clock_offset_ms"] = _number(self.offset.ms)
            kept["clock_offset_error_ms"] = _number(self.offset.error_ms)
        if self.intrinsics is not None:
            kept["intrinsics_rms_px"] = _number(self.intrinsics.rms_px)
            kept["intrinsics_file"] = self.intrinsics_file
        if self.advice:
            kept["advice"] = list(self.advice)
        return kept


def _number(value: float | None) -> float | None:
    """Four digits are more than any of it is good for; what was not measurable is null."""
    return None if value is None or value != value else float(f"{value:.4g}")

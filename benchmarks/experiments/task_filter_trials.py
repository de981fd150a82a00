"""Trials whose fixed views are blurred, where the task is not, before they are encoded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.experiments.virtual_runs import VirtualRuns
from tams_app.records import Frame, Image, TaskRegion
from tams_app.study.plan import PlannedTrial
from tams_app.video.virtual.video import VirtualVideo

FILTERED = "filtered"
VIEWS = ("gt", "gs")  # the wrist's is of the task altogether
_NONE_KBPS, _FULL_KBPS = 400.0, 150.0  # no blur from this target on; all of it up to this one
_COARSE = 4  # the blurred picture is a fourth as wide
_FADE = 0.8  # from the region's edge outwards, in radii


@dataclass(frozen=True, slots=True)
class FilteredRuns(VirtualRuns):
    """Filters in the trials whose id says so."""

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        if FILTERED in trial.id:
            _filter_what_is_encoded()
        VirtualRuns.run(self, trial, folder)


def strength(target_kbps: float) -> float:
    """How much of what is outside is replaced by the blurred picture, 0 to 1."""
    share = (_NONE_KBPS - target_kbps) / (_NONE_KBPS - _FULL_KBPS)
    return min(1.0, max(0.0, share))


def filtered(image: Image, region: TaskRegion, share: float) -> Image:
    """`image` with `share` of what is outside `region` blurred; BGR, shape (height, width, 3)."""
    height, width = image.shape[:2]
    small = cv2.resize(image, (width // _COARSE, height // _COARSE), interpolation=cv2.INTER_AREA)
    blurred = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    outside = share * _outside(region, height, width)
    return np.asarray(cv2.blendLinear(image, blurred, 1.0 - outside, outside), np.uint8)


def _outside(region: TaskRegion, height: int, width: int) -> NDArray[np.float32]:
    """0 in the region, 1 from `_FADE` radii beyond its edge on, shape (height, width)."""
    y, x = np.ogrid[:height, :width]
    radii = np.hypot(x - region.x_px, y - region.y_px) / region.radius_px
    return np.clip((radii - 1.0) / _FADE, 0.0, 1.0).astype(np.float32)


def _filter_what_is_encoded() -> None:
    """From now on, in this process; what frames are compared with stays as it was captured."""
    targets: dict[str, float] = {}
    push: Callable[[VirtualVideo, Frame, bool], None] = VirtualVideo.push
    set_targets: Callable[[VirtualVideo, Mapping[str, float]], None] = VirtualVideo.set_targets

    def set_and_note(video: VirtualVideo, target_kbps: Mapping[str, float]) -> None:
        targets.update(target_kbps)
        set_targets(video, target_kbps)

    def push_filtered(video: VirtualVideo, frame: Frame, left_out: bool) -> None:
        share = strength(targets.get(frame.view, _NONE_KBPS)) if frame.view in VIEWS else 0.0
        if share > 0.0 and frame.task is not None:
            frame = replace(frame, image=filtered(frame.image, frame.task, share))
        push(video, frame, left_out)

    VirtualVideo.push = push_filtered  # type: ignore[method-assign, assignment]
    VirtualVideo.set_targets = set_and_note  # type: ignore[method-assign]

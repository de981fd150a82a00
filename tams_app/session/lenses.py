"""What is known of each view's camera: exactly of the rig's, by calibration of real ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date

import numpy as np

from hw.arms import arm_kind
from tams_app.config import CameraConfig, Config
from tams_app.records import ArmFigure, Lens, Pose
from tams_app.rotation import Rotation

WRIST_VIEW = "eih"
BASE = "base"


@dataclass(frozen=True, slots=True)
class Known:
    """Of a view's camera: its lens with its pose, and how good that is in words; or why not."""

    lens: Lens | None
    words: str


def known_lenses(config: Config, figure: ArmFigure | None) -> Mapping[str, Lens]:
    """By view, the lenses of the cameras whose pose is known, for pictures of the video's size."""
    found = {view: _known(config, view, figure).lens for view in config.video.views}
    return {view: lens for view, lens in found.items() if lens is not None}


def known_cameras(config: Config) -> Mapping[str, Known]:
    """What is known of the camera of each view."""
    figure = arm_kind(config.arm.model).figure()
    return {view: _known(config, view, figure) for view in config.video.views}


def _known(config: Config, view: str, figure: ArmFigure | None) -> Known:
    """A calibration counts before what the rig knows, which so can be given a wrong one."""
    camera = config.cameras.get(view)
    if camera is not None and camera.lens is not None:
        return _measured(config, camera, figure)
    if not config.rig.enabled:
        return Known(None, "its lens was not measured")
    if view == WRIST_VIEW and figure is None:
        return Known(None, "where the arm's flange is is not known")
    lens = rig_lens(view, figure, (config.video.width, config.video.height))
    return Known(lens, "exact, of the simulated rig" if lens else "the rig has no such camera")


def _measured(config: Config, camera: CameraConfig, figure: ArmFigure | None) -> Known:
    lens, mount, video = camera.lens, camera.mount, config.video
    assert lens is not None
    if mount is None:
        return Known(None, "where it is was not measured")
    if mount.frame == "arm" and figure is None:
        return Known(None, "where the arm's flange is is not known")
    parent = BASE if mount.frame == "base" or figure is None else figure.flange
    scaled = lens.at(mount.pose, parent).scaled_to(video.width, video.height)
    if scaled is None:
        return Known(
            None,
            f"its lens was measured in pictures of {lens.width}x{lens.height}, and the video is "
            f"{video.width}x{video.height}, of another shape",
        )
    words = f"lens {_bound(lens.error_px, lens.measured)}, mount " + _bound(
        mount.error_px, mount.measured
    )
    return Known(scaled, words)


def _bound(error_px: float, measured: date | None) -> str:
    return f"within {error_px:.2g} px" + (f" ({measured})" if measured else "")


def rig_lens(view: str, figure: ArmFigure | None, size: tuple[int, int]) -> Lens | None:
    """Of a camera of the rig, exactly; None: it has none, or no flange that the camera is on.

    `size`: width and height of the picture [px].
    """
    from hw.sim.layout import FIXED_VIEWPOINTS, WRIST_VIEWPOINT

    if view == WRIST_VIEW and figure is not None:
        wrist = WRIST_VIEWPOINT
        pose = Pose(np.array(wrist.place), Rotation.from_matrix(wrist.axes))
        return Lens.ideal(figure.flange, pose, wrist.fovy_deg, *size)
    if view not in FIXED_VIEWPOINTS:
        return None
    fixed = FIXED_VIEWPOINTS[view]
    pose = Pose(np.array(fixed.place), Rotation.from_matrix(fixed.axes))
    return Lens.ideal(BASE, pose, fixed.fovy_deg, *size)

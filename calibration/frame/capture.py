"""From the controller's samples to strokes and touches: what happens while the trigger is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.rotation import Matrix
from calibration.frame.touches import Touch
from tams_app.config import Config
from tams_app.records import ControllerSample, ControllerStatus, Pose, Vector
from tams_app.teleop.clutch import Clutch

MIN_TOUCH_SAMPLES = 20
MAX_TOUCH_TREMBLE_M = 0.005  # RMS while touching


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """The poses that arrived while the trigger was held, in order of time."""

    poses: tuple[Pose, ...]

    @property
    def positions(self) -> Matrix:
        """[m], shape (n, 3)."""
        return np.array([pose.position for pose in self.poses]).reshape(-1, 3)


class Capture:
    """Collects while the trigger is held, with the clutch's own rules for what that means."""

    def __init__(self, config: Config) -> None:
        self._clutch = Clutch(config.clutch, config.freshness.buttons_ms * 1e6)
        self._poses: list[Pose] | None = None  # None: the trigger is up
        self._pose_ns = 0

    @property
    def so_far(self) -> Held | None:
        """What has arrived since the trigger was squeezed; None while it is up."""
        return None if self._poses is None else Held(tuple(self._poses))

    def take(self, sample: ControllerSample, now_ns: int) -> Held | None:
        """Take in the newest sample; all of them at the release, else None.

        Refused if the tracking was lost meanwhile, or its frame changed at any time.
        """
        fingers = self._clutch.update(sample, now_ns)
        if sample.status is ControllerStatus.TRACKING_FRAME_CHANGED:
            self._poses = None
            raise RefusedError(
                Reason.FRAME_CHANGED,
                "The headset was recentred, so that nothing measured before holds any longer: "
                "let the trigger go for a second, and begin anew.",
            )
        if self._poses is not None and (
            sample.status is not ControllerStatus.OK or sample.pose is None
        ):
            self._poses = None
            raise RefusedError(
                Reason.TRACKING,
                f"The controller was lost while the trigger was held ({sample.status.value}): "
                "do it again where it is tracked.",
            )
        if fingers.press:
            self._poses = []
        if self._poses is None:
            return None
        if not fingers.pressed:
            done, self._poses = Held(tuple(self._poses)), None
            return done
        if sample.pose is not None and sample.pose_ns > self._pose_ns:
            self._poses.append(sample.pose)
            self._pose_ns = sample.pose_ns
        return None


def touch_of(held: Held, robot: Vector, number: int) -> Touch:
    """The touch of one of the robot's points [m]; Refused if the hand did not keep still."""
    if len(held.poses) < MIN_TOUCH_SAMPLES:
        raise RefusedError(
            Reason.TOO_FEW_SAMPLES,
            f"Point {number} was touched for a moment only: hold the trigger for half a second.",
        )
    place = np.median(held.positions, axis=0)
    tremble = float(np.sqrt(((held.positions - place) ** 2).sum() / len(held.poses)))
    if tremble > MAX_TOUCH_TREMBLE_M:
        raise RefusedError(
            Reason.NOISY,
            f"The hand moved by {1000 * tremble:.0f} mm while touching point {number}: "
            "rest the controller on the point, then squeeze the trigger.",
        )
    turn = Rotation.concatenate([pose.rotation for pose in held.poses]).mean()
    return Touch(robot, place, turn)

"""Where the controller is, since when, and which device is the operator's hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tams_app.records import Pose
from tams_app.runtime.clock import NS_PER_S

ADOPT_AFTER_NS = NS_PER_S  # a new device's trigger must have been up for this long
_TRIGGER_UP = 0.2
_ORTHONORMAL_WITHIN = 1e-2


def tracking_problem(vr: Any, device: Any) -> str:
    """Why the pose of a TrackedDevicePose_t is not to be trusted, "" if it is."""
    results = {
        vr.TrackingResult_Uninitialized: "not started yet",
        vr.TrackingResult_Calibrating_InProgress: "calibrating",
        vr.TrackingResult_Calibrating_OutOfRange: "calibrating, out of range",
        vr.TrackingResult_Running_OutOfRange: "out of range",
        vr.TrackingResult_Fallback_RotationOnly: "rotation only",
    }
    if device.eTrackingResult in results:
        return results[device.eTrackingResult]
    if not device.bPoseIsValid:
        return "no valid pose"
    matrix = _matrix(bytes(device.mDeviceToAbsoluteTracking))
    if not matrix[:, 3].any():
        return "no position"  # so streamed controllers say that they are lost (FINDINGS 11)
    return "" if _is_rigid(matrix) else "no sensible pose"


class PoseKeeper:
    """Keeps the pose and the time when its value last changed, to the last bit."""

    def __init__(self) -> None:
        self._raw = b""
        self._pose: Pose | None = None
        self.changed_ns = 0

    def update(self, device: Any, now_ns: int) -> Pose:
        """The pose of a TrackedDevicePose_t without a `tracking_problem`."""
        raw = bytes(device.mDeviceToAbsoluteTracking)
        if self._pose is None or raw != self._raw:
            matrix = _matrix(raw)
            self._raw, self.changed_ns = raw, now_ns
            self._pose = Pose(matrix[:, 3].copy(), Rotation.from_matrix(matrix[:, :3]))
        return self._pose


class HandKeeper:
    """Notices that another device plays the operator's hand.

    The runtime may give the hand to another controller at any time: one is switched on, off or
    laid down. A pose and a trigger that jump from one hand to the other must not move the arm, so
    the new device counts only after its trigger was seen up for ADOPT_AFTER_NS without a break,
    which shows that someone holds it and lets go. The old device coming back counts at once.
    """

    def __init__(self) -> None:
        self._mine = ""
        self._other = ""
        self._up_since_ns: int | None = None

    def is_swapped(self, serial: str, trigger: float | None, now_ns: int) -> bool:
        """Take in who plays the hand now; `trigger` is None where it cannot be read."""
        if serial == (self._mine or serial):
            self._mine, self._other = serial, ""
            return False
        if serial != self._other:
            self._other, self._up_since_ns = serial, None
        if trigger is None or not trigger <= _TRIGGER_UP:
            self._up_since_ns = None
            return True
        if self._up_since_ns is None:
            self._up_since_ns = now_ns
        if now_ns - self._up_since_ns < ADOPT_AFTER_NS:
            return True
        self._mine, self._other = serial, ""
        return False


def _matrix(raw: bytes) -> NDArray[np.float64]:
    """HmdMatrix34_t as it lies in memory: rotation and position [m], shape (3, 4)."""
    return np.frombuffer(raw, dtype=np.float32).reshape(3, 4).astype(np.float64)


def _is_rigid(matrix: NDArray[np.float64]) -> bool:
    # scipy raises for a matrix with NaN or a negative determinant
    if not np.isfinite(matrix).all():
        return False
    rotation = matrix[:, :3]
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    return bool(error < _ORTHONORMAL_WITHIN and np.linalg.det(rotation) > 0)

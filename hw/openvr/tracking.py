"""Trust in poses: tracking results, the operator's hand, and the standing frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.records import ControllerStatus, Pose, TakeNote
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S

RELEASED_FOR_NS = NS_PER_S  # how long the trigger must have been up
TRIGGER_UP = 0.2
_ORTHONORMAL_WITHIN = 1e-2
_SAME_WITHIN_M = 0.005
_SAME_WITHIN_RAD = np.radians(0.5)


def tracking_problem(vr: Any, device: Any) -> str:
    """The reason not to trust the pose of a TrackedDevicePose_t, "" if there is none."""
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
    matrix = pose_matrix(device)
    if not matrix[:, 3].any():
        return "no position"  # as streamed controllers report that they are lost (FINDINGS 11)
    return "" if _is_rigid(matrix) else "no sensible pose"


def pose_matrix(device: Any) -> NDArray[np.float64]:
    """Rotation and position [m] of a TrackedDevicePose_t, shape (3, 4)."""
    return _matrix(bytes(device.mDeviceToAbsoluteTracking))


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


class TriggerRelease:
    """Notices that the trigger was seen up for RELEASED_FOR_NS without a break."""

    def __init__(self) -> None:
        self._up_since_ns: int | None = None

    def seen(self, trigger: float | None, now_ns: int) -> bool:
        """Take in the trigger (0 to 1, None: unreadable); True if it was up for long enough."""
        if trigger is None or not trigger <= TRIGGER_UP:  # NaN is not up
            self._up_since_ns = None
            return False
        if self._up_since_ns is None:
            self._up_since_ns = now_ns
        return now_ns - self._up_since_ns >= RELEASED_FOR_NS


class HandKeeper:
    """Notices that another device plays the operator's hand.

    The runtime may give the hand to another controller at any time: one is switched on, off or
    laid down. A pose and a trigger that jump from one hand to the other must not move the arm, so
    the new device counts only after a `TriggerRelease`, which shows that it is held and let go.
    The old device coming back counts at once.
    """

    def __init__(self) -> None:
        self._mine = ""
        self._other = ""
        self._release = TriggerRelease()

    def is_swapped(self, serial: str, trigger: float | None, now_ns: int) -> bool:
        """Take in who plays the hand now; `trigger` is None where it cannot be read."""
        if serial == (self._mine or serial):
            self._mine, self._other = serial, ""
            return False
        if serial != self._other:
            self._other = serial
            self._release = TriggerRelease()
        if not self._release.seen(trigger, now_ns):
            return True
        self._mine, self._other = serial, ""
        return False


class FrameKeeper:
    """Notices that the standing frame, in which every pose is given, was turned or moved.

    Recentring the headset turns the frame under a hand that goes on as before: "forward" then
    leads the arm elsewhere. So from a change on nothing counts until a `TriggerRelease`. Keep one
    over all connections: a runtime that was restarted may have another frame than before.
    """

    def __init__(self) -> None:
        self._frame: NDArray[np.float64] | None = None
        self._changed = False
        self._release = TriggerRelease()

    def note_event(self) -> None:
        """The runtime reports that the frame was moved."""
        self._changed = True
        self._release = TriggerRelease()

    def look(self, raw_to_standing: Any) -> None:
        """Compare an HmdMatrix34_t, from the tracking's own frame to the standing one.

        Slow corrections of the runtime count once they add up.
        """
        frame = _matrix(bytes(raw_to_standing))
        if self._frame is None:
            self._frame = frame
        elif not _is_same(frame, self._frame):
            self._frame = frame
            self.note_event()

    def is_changed(self, trigger: float | None, now_ns: int) -> bool:
        """True if poses are not to be trusted yet; `trigger` is None where it is unreadable."""
        if self._changed and self._release.seen(trigger, now_ns):
            self._changed = False
        return self._changed


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


def _is_same(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """False also for what is not a number."""
    moved_m = np.linalg.norm(a[:, 3] - b[:, 3])
    # of a small turn: the Frobenius norm of the difference is the angle times the root of 2
    turned_rad = np.linalg.norm(a[:, :3] - b[:, :3]) / np.sqrt(2.0)
    return bool(moved_m <= _SAME_WITHIN_M and turned_rad <= _SAME_WITHIN_RAD)


QUIET_NS = 200 * NS_PER_MS  # what flickers faster than this is reported as it ends up
UNREAD_AFTER_NS = 2 * NS_PER_S


class Announcer:
    """Turns states into notes of level and text, without repeating itself."""

    def __init__(self, note: TakeNote) -> None:
        self._note = note
        self._notified: tuple[ControllerStatus, str] | None = None
        self._notified_ns = 0
        self._failure = ""
        self._unread: tuple[str, ...] = ()
        self._unread_since_ns: int | None = None
        self._unknown: set[str] = set()

    def notify(self, status: ControllerStatus, why: str, now_ns: int) -> None:
        """Note the status if it is new."""
        if (status, why) == self._notified:
            return
        if self._notified is not None and now_ns - self._notified_ns < QUIET_NS:
            return
        self._notified, self._notified_ns = (status, why), now_ns
        level = "info" if status is ControllerStatus.OK else "warning"
        self._note(level, f"controller: {status.value}" + (f", {why}" if why else ""))

    def notify_failure(self, sentence: str) -> None:
        """Note why the runtime cannot be reached, if that is new."""
        if sentence != self._failure:
            self._failure = sentence
            self._note("warning", sentence)

    def forget_failure(self) -> None:
        """The runtime was reached."""
        self._failure = ""

    def notify_unread(self, unread: tuple[str, ...], now_ns: int) -> None:
        """Note what a tracked controller has not delivered for UNREAD_AFTER_NS: not bound."""
        if not unread:
            self._unread, self._unread_since_ns = (), None
        elif self._unread_since_ns is None:
            self._unread_since_ns = now_ns
        elif unread != self._unread and now_ns - self._unread_since_ns >= UNREAD_AFTER_NS:
            self._unread = unread
            self._note(
                "warning",
                f"SteamVR delivers no {', '.join(unread)} of the controller: look whether they "
                "are bound under SteamVR's Settings, Controllers, Manage Controller Bindings",
            )

    def notify_unknown_type(self, controller_type: str) -> None:
        """Note a type of controller whose buttons TAMS can only guess."""
        if controller_type not in self._unknown:
            self._unknown.add(controller_type)
            self._note(
                "warning",
                f"the controller's type {controller_type!r} is not one TAMS knows: "
                "try each button in a dry run before the arm moves",
            )

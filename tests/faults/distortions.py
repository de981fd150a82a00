"""What a tracking runtime may make of a hand: from the true reading and the last one delivered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS
from tests.faults.hand import Distortion

_NO_BUTTONS = (
    ControllerStatus.DISCONNECTED,
    ControllerStatus.STANDBY,
    ControllerStatus.DASHBOARD,
    ControllerStatus.RUNTIME_QUIT,
    ControllerStatus.ROLE_SWAPPED,
    ControllerStatus.TRACKING_FRAME_CHANGED,
)
_WITH_POSE = (ControllerStatus.DASHBOARD, ControllerStatus.ROLE_SWAPPED)


def status(value: ControllerStatus) -> Distortion:
    """The runtime says so, with what it then still delivers."""

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        sample = replace(true, status=value)
        if value not in _WITH_POSE:
            sample = replace(sample, pose=None, pose_ns=last.pose_ns)
        if value in _NO_BUTTONS:
            sample = replace(
                sample, buttons_ns=last.buttons_ns, trigger=0.0, a=False, b=False, menu=False
            )
        return sample

    return distort


def invalid(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    """No pose, everything else is as always."""
    return replace(true, pose=None, pose_ns=last.pose_ns)


def zero_pose(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    """(0, 0, 0): how some runtimes report that they lost it."""
    was_zero = last.pose is not None and not last.pose.position.any()
    pose = last.pose if was_zero else Pose(np.zeros(3), Rotation.identity())
    return replace(true, pose=pose, pose_ns=last.pose_ns if was_zero else true.pose_ns)


def nan_position(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    position = np.array([0.0, np.nan, 0.0])
    return replace(true, pose=Pose(position, Rotation.identity()))


def infinite_position(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    position = np.array([np.inf, 1.0, 0.0])
    return replace(true, pose=Pose(position, Rotation.identity()))


def nan_rotation(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    assert true.pose is not None
    rotation = Rotation.from_rotvec([np.nan, 0.0, 0.0])
    return replace(true, pose=Pose(true.pose.position, rotation))


def nan_trigger(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    return replace(true, trigger=float("nan"))


def from_the_future(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    return replace(true, pose_ns=true.pose_ns + 200 * NS_PER_MS)


def frozen_pose(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    """The pose as it was, the buttons alive."""
    return replace(true, pose=last.pose, pose_ns=last.pose_ns)


def frozen_buttons(true: ControllerSample, last: ControllerSample) -> ControllerSample:
    """The buttons as they were, the pose alive."""
    return replace(true, trigger=last.trigger, buttons_ns=last.buttons_ns)


def repeated() -> Distortion:
    """Every reading twice: a source of half our rate."""
    count = 0

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        nonlocal count
        count += 1
        return last if count % 2 else true

    return distort


def shuffled() -> Distortion:
    """Every third pose is overtaken by its follower and arrives after it, with its own time."""
    overtaken: ControllerSample | None = None
    count = 0

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        nonlocal overtaken, count
        count += 1
        if count % 3 == 1:
            overtaken = true
            return frozen_pose(true, last)
        if count % 3 == 0 and overtaken is not None:
            return replace(true, pose=overtaken.pose, pose_ns=overtaken.pose_ns)
        return true

    return distort


def delayed(by_ns: int) -> Distortion:
    """Poses as they were `by_ns` ago; their time is that of their arrival, the buttons' too."""
    waiting: list[ControllerSample] = []

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        waiting.append(true)
        due = [old for old in waiting if true.pose_ns - old.pose_ns >= by_ns]
        if not due:
            return frozen_pose(true, last)
        del waiting[: len(due) - 1]
        return replace(true, pose=due[-1].pose)

    return distort


def old(by_ns: int) -> Distortion:
    """Poses that say themselves that they are `by_ns` old; the buttons are on time."""

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        return replace(true, pose_ns=true.pose_ns - by_ns)

    return distort


def jump_once(by_m: float) -> Distortion:
    """The tracking finds the hand elsewhere, and stays with that."""

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        assert true.pose is not None
        moved = true.pose.position + np.array([by_m, 0.0, 0.0])
        return replace(true, pose=Pose(moved, true.pose.rotation))

    return distort


def jump_about(by_m: float) -> Distortion:
    """There and back, at each reading."""
    away = False

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        nonlocal away
        away = not away
        return jump_once(by_m)(true, last) if away else true

    return distort


def jump_slowly(by_m: float, ticks: int) -> Distortion:
    """As `jump_once`, but spread over so many readings that the hand might have done it."""
    count = 0

    def distort(true: ControllerSample, last: ControllerSample) -> ControllerSample:
        nonlocal count
        count = min(count + 1, ticks)
        return jump_once(by_m * count / ticks)(true, last)

    return distort

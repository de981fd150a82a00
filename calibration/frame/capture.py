"""Strokes from the controller's samples, live or from the log of a session."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.frame.fit import Matrix
from calibration.frame.stroke import AXES, BeginAgainError, RefusedError, Stroke
from tams_app.config import Config
from tams_app.console.report import session_log
from tams_app.recording import read_log, read_ticks
from tams_app.records import ControllerSample, ControllerStatus, Pose, Tick
from tams_app.teleop.clutch import Clutch
from tams_app.teleop.safety import ArmingState


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """The poses that arrived while the trigger was held, in order of time."""

    poses: tuple[Pose, ...]

    @property
    def positions(self) -> Matrix:
        """[m], shape (n, 3)."""
        return np.array([pose.position for pose in self.poses]).reshape(-1, 3)


class StrokeCapture:
    """Collects while the trigger is held, with the clutch's own rules for what that means."""

    def __init__(self, config: Config) -> None:
        self._clutch = Clutch(config.freshness.buttons_ms * 1e6)
        self._poses: list[Pose] | None = None  # None: the trigger is up
        self._pose_ns = 0

    @property
    def so_far(self) -> Held | None:
        """What has arrived since the trigger was squeezed; None while it is up."""
        return None if self._poses is None else Held(tuple(self._poses))

    def take(self, sample: ControllerSample, now_ns: int) -> Held | None:
        """Take in the newest sample; all of them at the release, else None.

        RefusedError if the tracking was lost meanwhile, BeginAgainError if its frame changed.
        """
        buttons = self._clutch.update(sample, now_ns)
        if sample.status is ControllerStatus.TRACKING_FRAME_CHANGED:
            self._poses = None
            raise BeginAgainError(
                "The headset was recentred, so that nothing measured before holds any longer: "
                "let the trigger go for a second, and begin anew.",
            )
        if self._poses is not None and (
            sample.status is not ControllerStatus.OK or sample.pose is None
        ):
            self._poses = None
            raise RefusedError(
                f"The controller was lost while the trigger was held ({sample.status.value}): "
                "do it again where it is tracked.",
            )
        if buttons.press:
            self._poses = []
        if self._poses is None:
            return None
        if not buttons.pressed:
            done, self._poses = Held(tuple(self._poses)), None
            return done
        if sample.pose is not None and sample.pose_ns > self._pose_ns:
            self._poses.append(sample.pose)
            self._pose_ns = sample.pose_ns
        return None


MIN_TRAVEL_M = 0.060  # less is a squeeze of the trigger, no stroke


def strokes_of_log(folder: Path, config: Config) -> list[Stroke]:
    """The strokes in a session's log, +x, +y, +z over and over; UnreadableLogError or
    RefusedError."""
    try:
        return find_strokes(read_ticks(session_log(folder)), config)
    except (RefusedError, BeginAgainError) as error:
        raise RefusedError(f"{folder}: {error}") from error


def was_simulated(folder: Path) -> bool:
    """Whether the session ran on the simulated rig, and so in its tracking frame."""
    return bool(read_log(session_log(folder)).header.config["rig"]["enabled"])


def find_strokes(ticks: Iterable[Tick], config: Config) -> list[Stroke]:
    """Each stretch with the trigger held is the next stroke, if the hand went somewhere.

    RefusedError for a session in which the arm was driven. There the arm follows the hand by the
    rotation in force, so the pairs of their travels give that rotation and nothing of how the
    frames truly stand; and the hand goes where the task needs it, not along the robot's axes.
    """
    capture, found = StrokeCapture(config), list[Held]()
    for tick in ticks:
        if tick.arming.lower() == ArmingState.ENGAGED.value:
            raise RefusedError(
                "In this session the hand drove the arm, which shows the mapping in force and not "
                "the true one: record strokes with `run --dry-run` without arming, and give that.",
            )
        held = capture.take(tick.controller, tick.started_ns)
        if held is not None and travel_m(held) >= MIN_TRAVEL_M:
            found.append(held)
    if not found or len(found) % len(AXES):
        raise RefusedError(
            f"The session has {len(found)} strokes with the trigger held, and it takes a multiple "
            "of three: +x, +y, +z, in this order, once or more often.",
        )
    return [Stroke(n % len(AXES), held.positions) for n, held in enumerate(found)]


def travel_m(held: Held) -> float:
    """From the first place to the farthest from it [m]."""
    positions = held.positions
    if not len(positions):
        return 0.0
    return float(np.linalg.norm(positions - positions[0], axis=1).max())

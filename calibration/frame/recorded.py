"""Strokes and what is wrong with them, found in the log of a session."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from calibration.frame.capture import Capture, Held
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.stroke import AXES, Stroke
from tams_app.config import Config
from tams_app.errors import UnreadableLogError
from tams_app.recording import read_log, read_ticks
from tams_app.records import Tick
from tams_app.session.recorders import LOG_NAME
from tams_app.teleop.safety import ArmingState

MIN_TRAVEL_M = 0.060  # less is a squeeze of the trigger, no stroke


def strokes_of_log(folder: Path, config: Config) -> list[Stroke]:
    """The strokes in a session's log, +x, +y, +z repeated; UnreadableLogError or RefusedError."""
    try:
        return find_strokes(read_ticks(_log_of(folder)), config)
    except RefusedError as error:
        raise RefusedError(error.reason, f"{folder}: {error}") from error


def was_simulated(folder: Path) -> bool:
    """Whether the session ran on the simulated rig, and so in its tracking frame."""
    return bool(read_log(_log_of(folder)).header.config["rig"]["enabled"])


def find_strokes(ticks: Iterable[Tick], config: Config) -> list[Stroke]:
    """Each stretch with the trigger held is the next stroke, if the hand went somewhere.

    Refused for a session in which the arm was driven. There the arm follows the hand by the
    rotation in force, so the pairs of their travels tell that rotation and nothing of how the
    frames truly stand; and the hand goes where the task needs it, not along the robot's axes.
    """
    capture, found = Capture(config), list[Held]()
    for tick in ticks:
        if tick.arming.lower() == ArmingState.ENGAGED.value:
            raise RefusedError(
                Reason.DRIVEN,
                "In this session the hand drove the arm, which shows the mapping in force and not "
                "the true one: record strokes with `run --dry-run` without arming, and give that.",
            )
        held = capture.take(tick.controller, tick.started_ns)
        if held is not None and travel_m(held) >= MIN_TRAVEL_M:
            found.append(held)
    if not found or len(found) % len(AXES):
        raise RefusedError(
            Reason.MISSING,
            f"The session has {len(found)} strokes with the trigger held, and it takes a multiple "
            "of three: +x, +y, +z, in this order, once or more often.",
        )
    return [Stroke(n % len(AXES), held.positions) for n, held in enumerate(found)]


def _log_of(folder: Path) -> Path:
    path = folder / LOG_NAME if folder.is_dir() else folder
    if not path.is_file():
        raise UnreadableLogError(f"{folder}: holds no {LOG_NAME}: give a session folder")
    return path


def travel_m(held: Held) -> float:
    """From the first place to the farthest from it [m]."""
    positions = held.positions
    if not len(positions):
        return 0.0
    return float(np.linalg.norm(positions - positions[0], axis=1).max())

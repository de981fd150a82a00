"""An operator's hand with a tracked controller, moved by a process of its own.

Nothing that its owner is busy with makes the hand stand still, which the application would take
for a frozen pose.
"""

from __future__ import annotations

import multiprocessing
import time
from pathlib import Path

import numpy as np

from tams_app.records import Vector
from tams_app.runtime.realtime import OPERATOR_PRIORITY, use_fifo

POSE = (3, 4)
_PERIOD_S = 0.004
_SPEED_AT = 12 * 8  # behind the pose
_START_M = (0.1, 1.0, -0.3)
_TREMOR_M, _TREMOR_RAD_S = 1e-5, 40.0


class Hand:
    """Moves up at `speed_m_s`, and trembles as hands do; its pose is in the file `path`."""

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(_SPEED_AT + 8))
        pose = pose_in(path, "r+")
        pose[:] = np.hstack([np.eye(3), np.array(_START_M)[:, None]])
        self._speed = _speed_in(path, "r+")
        self._process = multiprocessing.get_context("spawn").Process(
            target=_move, args=(path,), daemon=True
        )
        self._process.start()

    def move(self, speed_m_s: float) -> None:
        """Move up at this speed from now on."""
        self._speed[0] = speed_m_s

    def close(self) -> None:
        self._process.terminate()
        self._process.join()


def pose_in(path: Path, mode: str = "r") -> Vector:
    """The controller's pose in the tracking frame, shape `POSE`, as it is at any moment."""
    return np.asarray(np.memmap(path, np.float64, mode, 0, POSE))  # type: ignore[call-overload]


def _speed_in(path: Path, mode: str) -> Vector:
    return np.asarray(np.memmap(path, np.float64, mode, _SPEED_AT, (1,)))  # type: ignore[call-overload]


def _move(path: Path) -> None:
    use_fifo(OPERATOR_PRIORITY)
    pose, speed = pose_in(path, "r+"), _speed_in(path, "r")
    last_s = time.monotonic()
    while True:
        time.sleep(_PERIOD_S)
        now_s = time.monotonic()
        pose[1, 3] += speed[0] * (now_s - last_s)
        pose[0, 3] = _START_M[0] + _TREMOR_M * np.sin(_TREMOR_RAD_S * now_s)
        last_s = now_s

"""How near the predictive display came to where the arm then was, by the states that came later."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.recording import SessionLog
from tams_app.records import MountPrediction, Pose
from tams_app.summary.tables import Flags, Floats, percentiles, ratio

_MOVED_M = 0.002  # since the newest state: else there is nothing to predict
_NAMES = ("p50", "p95")


def prediction_errors(log: SessionLog) -> dict[str, Any]:
    """The entry `prediction` of summary.json; all null where nothing was predicted.

    Errors are of the flange, of predictions for times at which its pose became known later, while
    it had moved by more than 2 mm since the newest state.
    """
    told = log.predictions
    error_mm, newest_mm, error_deg = _errors(told) if told else (np.empty(0),) * 3
    return {
        "error_mm": percentiles(error_mm, _NAMES),
        "error_deg": percentiles(error_deg, _NAMES),
        "newest_state_mm": percentiles(newest_mm, _NAMES),
        "trusted_fraction": ratio(sum(one.trusted for one in told), len(told)),
        "camera_fits": all(one.camera_fits for one in told) if told else None,
    }


def _errors(told: list[MountPrediction]) -> tuple[Floats, Floats, Floats]:
    """Of the predictions that count: their error, and what the newest state was off by."""
    states = {one.then_ns: one.then for one in told}
    times_ns = np.array(sorted(states), dtype=np.int64)
    known = _numbers([states[t_ns] for t_ns in times_ns.tolist()])
    predicted, newest = _numbers([one.now for one in told]), _numbers([one.then for one in told])
    at_ns = np.array([one.now_ns + one.offset_ns for one in told], dtype=np.int64)
    since_ns = at_ns - times_ns[0]
    true = np.stack(
        [np.interp(since_ns, times_ns - times_ns[0], column) for column in known.T], axis=1
    )
    newest_m = np.linalg.norm((newest - true)[:, :3], axis=1)
    counts: Flags = (at_ns <= times_ns[-1]) & (newest_m > _MOVED_M)
    error_m = np.linalg.norm((predicted - true)[:, :3], axis=1)
    turn_rad = _angles(predicted[:, 3:], true[:, 3:])
    return error_m[counts] * 1e3, newest_m[counts] * 1e3, np.degrees(turn_rad[counts])


def _numbers(poses: list[Pose]) -> NDArray[np.float64]:
    """Position [m] and quaternion, of the two the one nearer to that before, shape (n, 7)."""
    rows = np.array([(*pose.position, *pose.rotation) for pose in poses])
    cosines = (rows[1:, 3:] * rows[:-1, 3:]).sum(axis=1)
    rows[1:, 3:] *= np.cumprod(np.where(cosines < 0.0, -1.0, 1.0))[:, None]
    return rows


def _angles(one: NDArray[np.float64], other: NDArray[np.float64]) -> Floats:
    """Between the rotations of quaternions, shape (n, 4) [rad]."""
    cosines = np.abs((one * other).sum(axis=1)) / np.linalg.norm(other, axis=1)
    angles: Floats = 2.0 * np.arccos(np.clip(cosines, 0.0, 1.0))
    return angles

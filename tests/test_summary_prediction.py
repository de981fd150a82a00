"""How near predictions came, on states and predictions whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from tams_app.recording import SessionLog
from tams_app.records import MountPrediction, Pose
from tams_app.rotation import Rotation
from tams_app.summary.prediction import prediction_errors
from tams_app.units import NS_PER_MS
from tests.synthetic_session import START_NS, header

pytestmark = pytest.mark.untimed

SPEED_M_S, EACH_MS, LATE_MS = 0.1, 10, 100
TURN_RAD_S = 0.5


def flange(t_ms: float) -> Pose:
    turn = Rotation.from_rotvec((0.0, 0.0, TURN_RAD_S * t_ms / 1e3))
    return Pose(np.array([0.3 + SPEED_M_S * t_ms / 1e3, 0.0, 0.2]), turn)


def log_of(error_m: float = 0.0, turned_rad: float = 0.0, offset_ms: int = 0) -> SessionLog:
    """Two seconds of an arm that goes on at one speed; states are a tenth of a second late."""
    log = SessionLog(header(), START_NS)
    for now_ms in range(500, 2500, EACH_MS):
        true = flange(now_ms)
        now = Pose(
            true.position + np.array([0.0, error_m, 0.0]),
            true.rotation * Rotation.from_rotvec((turned_rad, 0.0, 0.0)),
        )
        then_ms = now_ms - LATE_MS
        log.predictions.append(
            MountPrediction(
                START_NS + then_ms * NS_PER_MS,
                flange(then_ms),
                START_NS + (now_ms - offset_ms) * NS_PER_MS,
                now,
                trusted=now_ms % 40 != 0,
                offset_ns=offset_ms * NS_PER_MS,
            )
        )
    return log


def test_predictions_that_came_true_have_no_error_and_the_newest_state_has_that_of_its_age() -> (
    None
):
    found = prediction_errors(log_of())
    assert found["error_mm"]["p95"] == pytest.approx(0.0, abs=1e-3)
    assert found["error_deg"]["p95"] == pytest.approx(0.0, abs=1e-2)
    assert found["newest_state_mm"]["p50"] == pytest.approx(10.0, abs=1e-3)
    assert found["trusted_fraction"] == pytest.approx(0.75)


@pytest.mark.parametrize("offset_ms", [0, 70, -4000])
def test_errors_are_those_of_place_and_rotation_whatever_the_clocks(offset_ms: int) -> None:
    found = prediction_errors(log_of(0.003, 0.02, offset_ms))
    assert found["error_mm"]["p50"] == pytest.approx(3.0, abs=1e-3)
    assert found["error_deg"]["p50"] == pytest.approx(np.degrees(0.02), abs=1e-2)


def test_a_flange_that_is_half_a_turn_from_its_start_has_no_error_between_its_states() -> None:
    """There the quaternion nearer to the first one changes its sign with each motion."""

    def turn(step: int) -> Rotation:
        around = (0.04, 0.0, -0.04, 0.0)[step % 4] if step > 40 else 0.0
        return Rotation.from_rotvec((0.0, 0.0, min(step, 40) * np.pi / 40 + around))

    log = log_of()
    log.predictions = [
        MountPrediction(
            one.then_ns,
            Pose(one.then.position, turn(2 * max(0, number - LATE_MS // EACH_MS))),
            one.now_ns + EACH_MS * NS_PER_MS // 2,  # between two states
            Pose(one.now.position, turn(2 * number + 1)),
        )
        for number, one in enumerate(log.predictions)
    ]
    assert prediction_errors(log)["error_deg"]["p95"] < 0.1


def test_of_an_arm_that_rests_there_is_nothing_to_predict() -> None:
    log = log_of(0.003)
    rest = flange(0)
    log.predictions = [
        MountPrediction(one.then_ns, rest, one.now_ns, rest) for one in log.predictions
    ]
    assert prediction_errors(log)["error_mm"] == {"p50": None, "p95": None}


def test_what_no_later_state_tells_of_does_not_count() -> None:
    log = log_of()
    last = log.predictions[-1]
    far = Pose(last.now.position + 1.0, last.now.rotation)
    log.predictions.append(MountPrediction(last.then_ns, last.then, last.now_ns + 1, far))
    assert prediction_errors(log)["error_mm"]["p95"] == pytest.approx(0.0, abs=1e-3)


def test_without_predictions_nothing_is_known() -> None:
    found = prediction_errors(SessionLog(header(), START_NS))
    assert found["error_mm"] == {"p50": None, "p95": None}
    assert found["trusted_fraction"] is None

"""What the operator was shown, in summary.json: glances and predictions whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tams_app.recording import SessionLog
from tams_app.records import MountPrediction, OperatorGlance, Phase, PhaseChange, Pose
from tams_app.rotation import Rotation
from tams_app.summary.operator import operator, prediction_errors
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.synthetic_session import START_NS, header

pytestmark = pytest.mark.untimed

# the primary view: gt (the first of equals) everywhere but in ALIGN, where it is eih
PHASES = [(0, Phase.REACH), (2, Phase.ALIGN), (4, Phase.REACH)]


def log_of(*glances: OperatorGlance) -> SessionLog:
    log = SessionLog(header(), START_NS)
    log.phases = [
        PhaseChange(START_NS + at_s * NS_PER_S, phase, "planted") for at_s, phase in PHASES
    ]
    log.glances = list(glances)
    return log


def glance(at_s: float, to_block=None, to_container=None, about_block=True) -> OperatorGlance:
    return OperatorGlance(
        t_ns=START_NS + round(at_s * NS_PER_S),
        stage="reach",
        to_block=to_block or {},
        to_container=to_container or {},
        about_block=about_block,
        block_sigma=0.001,
        container_sigma=0.002,
        lag_ns=0,
        hanging=(),
    )


def test_shares_are_the_mean_over_the_glances_of_a_phase():
    relied = operator(
        log_of(
            glance(0.5, {"eih": 0.8, "gt": 0.2}),
            glance(1.5, {"gt": 0.6, "gs": 0.4}),
            glance(2.5, {"eih": 1.0}),
            glance(4.5, {"gt": 0.4, "gs": 0.6}),
        )
    )["relied_on"]
    assert relied["by_phase"] == {
        "REACH": {"eih": pytest.approx(0.8 / 3, abs=1e-4), "gt": 0.4, "gs": 0.3333},
        "ALIGN": {"eih": 1.0, "gt": 0.0, "gs": 0.0},
    }
    assert relied["n"] == {"REACH": 3, "ALIGN": 1}


def test_agreement_is_the_fraction_of_glances_that_relied_most_on_the_primary_view():
    relied = operator(
        log_of(
            glance(0.5, {"eih": 0.8, "gt": 0.2}),  # gt is primary
            glance(1.5, {"gt": 0.6, "gs": 0.4}),
            glance(2.5, {"eih": 0.9, "gs": 0.1}),
            glance(2.6, {"eih": 0.4, "gs": 0.6}),
        )
    )["relied_on"]
    assert relied["agreement"] == 0.5


def test_what_counts_is_what_the_operator_was_about():
    told = {"to_block": {"eih": 1.0}, "to_container": {"gs": 1.0}}
    relied = operator(log_of(glance(0.1, **told), glance(2.1, about_block=False, **told)))
    assert relied["relied_on"]["by_phase"] == {
        "REACH": {"eih": 1.0, "gt": 0.0, "gs": 0.0},
        "ALIGN": {"eih": 0.0, "gt": 0.0, "gs": 1.0},
    }


def test_glances_that_told_nothing_or_came_before_the_first_phase_are_left_out():
    relied = operator(log_of(glance(-0.5, {"gt": 1.0}), glance(0.5), glance(1.0, {"gt": 1.0})))
    assert relied["relied_on"]["n"] == {"REACH": 1}


def test_without_glances_nothing_is_claimed():
    assert set(operator(log_of()).values()) == {None}
    told = operator(log_of(glance(0.5)))
    assert told["relied_on"] == {"by_phase": {}, "n": {}, "agreement": None}


def test_who_worked_and_how_often_they_looked_is_told():
    log = log_of(*(glance(0.1 * number) for number in range(1, 6)))
    log.facts["operator"] = "seeing"
    told = operator(log)
    assert (told["kind"], told["glances_per_s"]) == ("seeing", 10.0)
    assert operator(log_of(glance(0.1)))["glances_per_s"] is None


def test_how_sure_the_operator_was_is_told_by_stage():
    sure = [replace(glance(0.1), block_sigma=sigma) for sigma in (0.001, 0.002, 0.009)]
    carrying = replace(glance(2.5, about_block=False), stage="carry", container_sigma=0.004)
    told = operator(log_of(*sure, carrying))["uncertainty_mm"]
    assert told["reach"]["p50"] == pytest.approx(2.0)
    assert told["reach"]["p95"] == pytest.approx(8.3)
    assert told["carry"] == {"p50": pytest.approx(4.0), "p95": pytest.approx(4.0), "n": 1}


SPEED_M_S, EACH_MS, LATE_MS = 0.1, 10, 100
TURN_RAD_S = 0.5


def flange(t_ms: float) -> Pose:
    turn = Rotation.from_rotvec((0.0, 0.0, TURN_RAD_S * t_ms / 1e3))
    return Pose(np.array([0.3 + SPEED_M_S * t_ms / 1e3, 0.0, 0.2]), turn)


def predicted(error_m: float = 0.0, turned_rad: float = 0.0, offset_ms: int = 0) -> SessionLog:
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
    found = prediction_errors(predicted())
    assert found["error_mm"]["p95"] == pytest.approx(0.0, abs=1e-3)
    assert found["error_deg"]["p95"] == pytest.approx(0.0, abs=1e-2)
    assert found["newest_state_mm"]["p50"] == pytest.approx(10.0, abs=1e-3)
    assert found["trusted_fraction"] == pytest.approx(0.75)


@pytest.mark.parametrize("offset_ms", [0, 70, -4000])
def test_errors_are_those_of_place_and_rotation_whatever_the_clocks(offset_ms: int) -> None:
    found = prediction_errors(predicted(0.003, 0.02, offset_ms))
    assert found["error_mm"]["p50"] == pytest.approx(3.0, abs=1e-3)
    assert found["error_deg"]["p50"] == pytest.approx(np.degrees(0.02), abs=1e-2)


def test_a_flange_that_is_half_a_turn_from_its_start_has_no_error_between_its_states() -> None:
    """There the quaternion nearer to the first one changes its sign with each motion."""

    def turn(step: int) -> Rotation:
        around = (0.04, 0.0, -0.04, 0.0)[step % 4] if step > 40 else 0.0
        return Rotation.from_rotvec((0.0, 0.0, min(step, 40) * np.pi / 40 + around))

    log = predicted()
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
    log = predicted(0.003)
    rest = flange(0)
    log.predictions = [
        MountPrediction(one.then_ns, rest, one.now_ns, rest) for one in log.predictions
    ]
    assert prediction_errors(log)["error_mm"] == {"p50": None, "p95": None}


def test_what_no_later_state_tells_of_does_not_count() -> None:
    log = predicted()
    last = log.predictions[-1]
    far = Pose(last.now.position + 1.0, last.now.rotation)
    log.predictions.append(MountPrediction(last.then_ns, last.then, last.now_ns + 1, far))
    assert prediction_errors(log)["error_mm"]["p95"] == pytest.approx(0.0, abs=1e-3)


def test_without_predictions_nothing_is_known() -> None:
    found = prediction_errors(SessionLog(header(), START_NS))
    assert found["error_mm"] == {"p50": None, "p95": None}
    assert found["trusted_fraction"] is None

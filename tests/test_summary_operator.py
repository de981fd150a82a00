"""Which view the operator relied on, in summary.json: shares on glances whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tams_app.recording import SessionLog
from tams_app.records import OperatorGlance, Phase, PhaseChange
from tams_app.summary.operator import operator
from tams_app.units import NS_PER_S
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

"""Who works in a live session: what was asked for and the machine's speed decide it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.glance_cost import glance_cpu_s, stored_views
from hw.sim.operator.seeing import SeeingPerception
from hw.sim.operator.task import Stage
from hw.sim.operator.vision.detections import Thing
from tams_app.session.operator_choice import (
    LEAST_GLANCES_HZ,
    SHARE_OF_MACHINE,
    choose_operator,
    eyes_share,
)
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed


def unmeasured() -> float:
    raise AssertionError("nothing is to be measured when the operator is named")


@pytest.mark.parametrize("kind", ["seeing", "scripted"])
def test_an_operator_that_is_named_works_whatever_the_machine(kind):
    choice = choose_operator(kind, unmeasured, cores=1)
    assert choice.kind == kind
    assert "as configured" in choice.sentence


@given(glance_s=st.floats(1e-4, 1.0), cores=st.integers(1, 256))
def test_the_operator_sees_where_there_is_time_for_enough_glances_and_only_there(glance_s, cores):
    choice = choose_operator("auto", lambda: glance_s, cores)
    enough = eyes_share(cores) / glance_s >= LEAST_GLANCES_HZ
    assert choice.kind == ("seeing" if enough else "scripted")
    assert choice == choose_operator("auto", lambda: glance_s, cores)
    assert "\n" not in choice.sentence


@given(cores=st.integers(1, 256))
def test_the_eyes_get_no_more_than_their_share_and_no_more_than_one_core(cores):
    assert 0.0 < eyes_share(cores) <= min(1.0, SHARE_OF_MACHINE * cores)


def test_the_sentence_says_who_works_and_what_was_measured():
    fast = choose_operator("auto", lambda: 0.016, cores=2).sentence
    assert fast.startswith("the seeing operator works, from the images on the screen alone: ")
    assert "16 ms" in fast
    slow = choose_operator("auto", lambda: 0.050, cores=2).sentence
    assert slow.startswith("the scripted operator works, who is told where things are: ")
    assert "50 ms" in slow
    assert "4.0 times a second, and 6 are needed" in slow


def test_a_glance_is_measured_on_views_in_which_all_there_is_can_be_seen():
    images = stored_views()
    eyes = SeeingPerception(lambda: images, EfferenceCopy(), 0.0, 0.0)
    for glance in range(1, 4):
        eyes.watch(glance * 80 * NS_PER_MS, Stage.REACH)
    assert all(eyes.belief.seen[thing] for thing in Thing)
    assert glance_cpu_s() > 0.0

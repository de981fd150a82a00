"""Who works in a live session: what was asked for and the machine's speed decide it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.runtime.machine_speed import MachineSpeed
from tams_app.station.operator_choice import (
    GLANCE_S,
    LEAST_GLANCES_HZ,
    SHARE_OF_MACHINE,
    choose_operator,
    eyes_share,
)

pytestmark = pytest.mark.untimed


def unmeasured() -> MachineSpeed:
    raise AssertionError("nothing is to be measured when the operator is named")


@pytest.mark.parametrize("kind", ["seeing", "scripted"])
def test_an_operator_that_is_named_works_whatever_the_machine(kind):
    choice = choose_operator(kind, unmeasured)
    assert choice.kind == kind
    assert "as configured" in choice.sentence


@given(speed=st.floats(0.01, 100.0), cores=st.integers(1, 256))
def test_the_operator_sees_where_there_is_time_for_enough_glances_and_only_there(speed, cores):
    machine = MachineSpeed(cores, speed)
    choice = choose_operator("auto", lambda: machine)
    enough = eyes_share(cores) / (GLANCE_S / speed) >= LEAST_GLANCES_HZ
    assert choice.kind == ("seeing" if enough else "scripted")
    assert choice == choose_operator("auto", lambda: machine)
    assert "\n" not in choice.sentence


@given(cores=st.integers(1, 256))
def test_the_eyes_get_no_more_than_their_share_and_no_more_than_one_core(cores):
    assert 0.0 < eyes_share(cores) <= min(1.0, SHARE_OF_MACHINE * cores)


def test_the_sentence_says_who_works_and_what_was_measured():
    fast = choose_operator("auto", lambda: MachineSpeed(2, GLANCE_S / 0.016)).sentence
    assert fast.startswith("simulated operator: seeing (uses only the received images): ")
    assert "16 ms" in fast
    slow = choose_operator("auto", lambda: MachineSpeed(2, GLANCE_S / 0.050)).sentence
    assert slow.startswith("simulated operator: scripted (gets positions from the simulator): ")
    assert "50 ms" in slow
    assert "4.0 images a second; seeing takes 6" in slow

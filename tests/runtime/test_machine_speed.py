"""The quick probe: a figure of the machine, and what follows from it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.robot import build
from tams_app.robot.rate_ladder import rungs
from tams_app.runtime.machine_speed import MachineSpeed, this_machine

pytestmark = pytest.mark.untimed

machines = st.builds(MachineSpeed, st.floats(0.5, 64.0), st.floats(0.1, 10.0))


def test_this_machine_is_measured_once() -> None:
    machine = this_machine()
    assert machine.capacity > 0.0
    assert this_machine() is machine


@given(machines, st.integers(5, 60))
def test_a_session_begins_on_a_rung(machine: MachineSpeed, asked_fps: int) -> None:
    assert machine.starting_fps(asked_fps) in rungs(asked_fps)


@given(machines, machines)
def test_a_faster_machine_never_begins_lower(one: MachineSpeed, other: MachineSpeed) -> None:
    slower, faster = sorted((one, other), key=lambda machine: machine.capacity)
    assert slower.starting_fps(30) <= faster.starting_fps(30)


def test_only_the_rigs_cameras_have_a_ladder_and_only_where_no_rate_is_fixed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(build, "this_machine", lambda: MachineSpeed(1, 0.2))
    ladder = build.rate_ladder(load_config(None))
    assert ladder is not None
    assert ladder.fps == 5
    assert build.rate_ladder(load_config(None, {"rig.fixed_fps": True})) is None
    cameras = {view: {"source": "pattern"} for view in ("eih", "gt", "gs")}
    assert build.rate_ladder(load_config(None, {"rig.enabled": False, "cameras": cameras})) is None


def test_the_ends_of_the_scale() -> None:
    assert MachineSpeed(8, 2.0).starting_fps(30) == 30
    assert MachineSpeed(1, 0.2).starting_fps(30) == 5

"""An arm of another make, named by a word in the configuration, works a whole session."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hw.arms import ARM_KINDS
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Activity, ServoMode
from tams_app.robot import build
from tams_app.session.virtual.runner import run_virtual_trial
from tests.session.virtual.runs import PARTICIPANT, WALL_NS, short

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(600)]


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Config:
    """The rig's configuration with the toy of tests/contract in place of the arm."""
    monkeypatch.setitem(ARM_KINDS, "toy", "tests.contract.toy_arm:KIND")
    return short(**{"arm.model": "toy", "network": "none", "seconds": 7})


@pytest.mark.verify
def test_a_session_with_the_second_arm_engages_moves_and_is_summarised(
    toy: Config, tmp_path: Path
) -> None:
    run_virtual_trial(toy, PARTICIPANT, tmp_path, WALL_NS)
    log = read_log(tmp_path / LOG_NAME)
    assert log.header.config["arm"]["model"] == "toy"
    engaged = [tick for tick in log.ticks if tick.arming == "engaged" and tick.arm is not None]
    states = [tick.arm for tick in engaged if tick.arm is not None]
    assert len(engaged) > 100
    assert not [tick.reason for tick in log.ticks if tick.arming == "fault"]
    assert {state.servo for state in states} == {ServoMode.VELOCITY}
    assert Activity.MOVING in {state.activity for state in states}
    moved_m = float(np.linalg.norm(states[-1].tcp.position - states[0].tcp.position))
    assert moved_m > 0.05
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert summary["views"]["eih"]["frames_shown"] > 30


def test_limits_are_those_of_the_configured_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ARM_KINDS, "toy", "tests.contract.toy_arm:KIND")
    within = {"limits.max_speed_mm_s": 250, "arm.ready_joints_deg": [175, 0, 90, 0, 90, 0]}
    with pytest.raises(ConfigError, match="joint 1 turns from -170 to 170 degrees, not to 175"):
        build.check_ready_pose(load_config(overrides={"arm.model": "toy", **within}))

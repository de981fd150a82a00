"""What was told to control and policy, fed through today's code, gives what the log says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tams_app.config import Config
from tams_app.recording import SessionLog, read_log
from tests.golden_logs import GOLDEN, golden_log
from tests.session.recompute import Comparison, recompute

pytestmark = pytest.mark.untimed

NAMES = list(GOLDEN)


@pytest.fixture(scope="module", params=NAMES)
def log(request: pytest.FixtureRequest) -> SessionLog:
    return read_log(golden_log(request.param))


def config_of(log: SessionLog) -> Config:
    return Config.model_validate(log.header.config)


def differing(found: dict[str, Comparison]) -> set[str]:
    return {name for name, one in found.items() if one.differing_ns}


def test_todays_code_does_what_it_did_when_the_golden_logs_were_made(log: SessionLog) -> None:
    found = recompute(log, config_of(log))
    assert differing(found) == set()
    assert found["command: velocity"].compared == len(log.ticks)
    assert found["targets"].compared == len(log.allocations)


def test_the_golden_logs_have_what_is_worth_comparing() -> None:
    feedback, outage = (read_log(golden_log(name)) for name in ("feedback", "outage"))
    assert len({tick.phase for tick in outage.ticks}) >= 4
    assert any(tick.gripper is not None for tick in outage.ticks)
    assert len({one.capacity_kbps for one in feedback.allocations}) > 20
    assert sum(len(one.view) for one in feedback.policy_inputs) > 1000
    assert any(tick.reason == "stale video" for tick in outage.ticks)


@pytest.mark.parametrize(
    ("name", "keys", "value", "expected"),
    [
        ("outage", ("hand", "translation_scale"), 0.9, "command: velocity"),
        ("outage", ("freshness", "video_hold_ms"), 5000.0, "arming"),
        ("outage", ("policy", "phases", "v_eps_mm_s"), 20.0, "phase"),
        ("feedback", ("policy", "budget", "delay_target_ms"), 5.0, "capacity"),
        ("outage", ("policy", "budget", "safety_factor"), 0.8, "targets"),
        ("feedback", ("strategy",), "equal", "targets"),
    ],
)
def test_what_another_setting_would_have_done_is_a_difference(
    name: str, keys: tuple[str, ...], value: Any, expected: str
) -> None:
    log = read_log(golden_log(name))
    tree = config_of(log).model_dump(mode="json")
    branch = tree
    for key in keys[:-1]:
        branch = branch[key]
    assert branch[keys[-1]] != value
    branch[keys[-1]] = value
    found = recompute(log, Config.model_validate(tree))
    assert expected in differing(found)


def test_one_command_that_was_logged_otherwise_is_found_at_its_time(log: SessionLog) -> None:
    number = len(log.ticks) // 2
    ticks = list(log.ticks)
    ticks[number] = replace(ticks[number], stop=not ticks[number].stop)
    found = recompute(replace(log, ticks=ticks), config_of(log))
    assert found["command: stop"].differing_ns == [ticks[number].started_ns]
    assert differing(found) == {"command: stop"}

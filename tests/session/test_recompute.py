"""What was told to control and policy, fed through today's code, gives what the log says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tams_app.config import Config
from tams_app.errors import UnreadableLogError
from tams_app.recording import SessionLog, read_log
from tams_app.records import Tick
from tams_app.session.recompute import Recomputed, recompute
from tests.golden_logs import GOLDEN, golden_log

pytestmark = pytest.mark.untimed

NAMES = list(GOLDEN)


@pytest.fixture(scope="module", params=NAMES)
def log(request: pytest.FixtureRequest) -> SessionLog:
    return read_log(golden_log(request.param))


def config_of(log: SessionLog) -> Config:
    return Config.model_validate(log.header.config)


def differing(found: Recomputed) -> set[str]:
    return {one.name for one in found.comparisons if one.differing}


def changed(log: SessionLog, **changes: Any) -> SessionLog:
    return replace(log, **changes)


def test_todays_code_does_what_it_did_when_the_golden_logs_were_made(log: SessionLog) -> None:
    found = recompute(log, config_of(log))
    assert found.same, differing(found)
    assert found.until_ns is None
    counts = {one.name: one.compared for one in found.comparisons}
    assert counts["command: velocity"] == len(log.ticks)
    assert counts["targets"] == len(log.allocations)


def test_the_golden_logs_have_what_is_worth_comparing() -> None:
    feedback, outage = (read_log(golden_log(name)) for name in ("feedback", "outage"))
    assert len({tick.phase for tick in feedback.ticks}) >= 4
    assert any(tick.gripper is not None for tick in feedback.ticks)
    assert len({one.capacity_kbps for one in feedback.allocations}) > 20
    assert sum(len(one.view) for one in feedback.policy_inputs) > 1000
    assert any(tick.reason == "stale video" for tick in outage.ticks)


@pytest.mark.parametrize(
    ("name", "keys", "value", "expected"),
    [
        ("feedback", ("hand", "translation_scale"), 0.9, "command: velocity"),
        ("outage", ("hand", "translation_scale"), 0.9, "command: velocity"),
        ("outage", ("freshness", "video_hold_ms"), 5000.0, "arming"),
        ("feedback", ("policy", "phases", "v_eps_mm_s"), 20.0, "phase"),
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
    (first,) = (one.first_ns for one in found.comparisons if one.name == expected)
    assert first is not None
    assert log.header.started_ns <= first < log.ended_ns


def test_one_command_that_was_logged_otherwise_is_found_at_its_time(log: SessionLog) -> None:
    number = len(log.ticks) // 2
    ticks = list(log.ticks)
    ticks[number] = replace(ticks[number], stop=not ticks[number].stop)
    found = recompute(changed(log, ticks=ticks), config_of(log))
    (stop,) = (one for one in found.comparisons if one.name == "command: stop")
    assert (stop.differing, stop.first_ns) == (1, ticks[number].started_ns)
    assert differing(found) == {"command: stop"}


def test_what_comes_after_missing_ticks_is_not_compared(log: SessionLog) -> None:
    ticks = [*log.ticks[:300], *log.ticks[310:]]
    found = recompute(changed(log, ticks=ticks), config_of(log))
    assert found.until_ns == log.ticks[299].started_ns
    assert found.same, differing(found)
    assert {one.compared for one in found.comparisons if one.name == "arming"} == {300}
    (targets,) = (one.compared for one in found.comparisons if one.name == "targets")
    assert targets == sum(one.t_ns <= found.until_ns for one in log.allocations)


def test_periods_that_the_loop_left_out_are_no_missing_ticks(log: SessionLog) -> None:
    period_ns = log.ticks[1].due_ns - log.ticks[0].due_ns

    def later(tick: Tick) -> Tick:
        return replace(tick, due_ns=tick.due_ns + period_ns, skipped=tick.skipped + 1)

    ticks = [*log.ticks[:300], *map(later, log.ticks[300:])]
    assert recompute(changed(log, ticks=ticks), config_of(log)).until_ns is None


def test_a_report_of_the_receivers_that_is_missing_ends_the_comparison_of_the_policy() -> None:
    log = read_log(golden_log("feedback"))
    inputs = [*log.policy_inputs[:20], *log.policy_inputs[21:]]
    found = recompute(changed(log, policy_inputs=inputs), config_of(log))
    (capacity,) = (one for one in found.comparisons if one.name == "capacity")
    assert capacity.compared == 20
    assert found.until_ns == log.allocations[19].t_ns
    assert found.same


@pytest.mark.parametrize("name", ["live-0.1", "virtual-0.1"])
def test_an_old_log_is_told_to_lack_what_the_loop_was_told(name: str) -> None:
    old = read_log(golden_log("feedback").parent / f"{name}.mcap")
    with pytest.raises(UnreadableLogError, match=r"TAMS 0\.1\.0 .* schema 4 or newer$"):
        recompute(old, config_of(read_log(golden_log("feedback"))))


def test_a_log_without_ticks_is_told(log: SessionLog) -> None:
    with pytest.raises(UnreadableLogError, match="no ticks"):
        recompute(changed(log, ticks=[]), config_of(log))


def test_an_arm_of_which_nothing_was_heard_is_a_difference(log: SessionLog) -> None:
    ticks = [replace(tick, arm=None) for tick in log.ticks]
    assert {"arming", "phase"} <= differing(recompute(changed(log, ticks=ticks), config_of(log)))

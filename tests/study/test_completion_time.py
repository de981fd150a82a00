"""The completion time from a log that no simulator judged."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tams_app.recording import SessionLog
from tams_app.records import Phase, PhaseChange
from tams_app.runtime.clock import NS_PER_S
from tams_app.study.completion_time import completion_time_s
from tests.synthetic_session import START_NS, header, tick

pytestmark = pytest.mark.untimed


def log(engaged_s: float | None, opened_s: tuple[float, ...]) -> SessionLog:
    record = SessionLog(header(), START_NS)
    for number in range(0, 1200, 12):
        one = tick(number)
        engaged = engaged_s is not None and one.due_ns >= START_NS + engaged_s * NS_PER_S
        record.ticks.append(replace(one, arming="engaged" if engaged else "ready"))
    record.phases.append(PhaseChange(START_NS, Phase.REACH, "start"))
    record.phases += [
        PhaseChange(START_NS + round(at * NS_PER_S), Phase.RELEASE, "gripper opened")
        for at in opened_s
    ]
    return record


def test_it_is_from_the_first_engagement_to_the_last_opening() -> None:
    found = completion_time_s(log(2.0, (1.0, 5.0, 9.0)))
    assert found is not None
    assert 6.89 < found < 7.01  # ticks of 100 ms


def test_without_engagement_or_opening_there_is_none() -> None:
    assert completion_time_s(log(None, (5.0,))) is None
    assert completion_time_s(log(2.0, ())) is None
    assert completion_time_s(log(2.0, (1.0,))) is None  # opened before the trial began

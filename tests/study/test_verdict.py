"""The verdict: the log's time, and answers that fit each other and the rules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tams_app.config import TrialConfig
from tams_app.recording import SessionLog
from tams_app.records import PacketRecord, Phase, PhaseChange
from tams_app.study.guided import (
    DROPS_FACT,
    PLACED_FACT,
    Marks,
    ask_verdict,
    completion_time_s,
    marks_in,
    marks_of,
)
from tams_app.study.plan import Verdict
from tams_app.units import NS_PER_S
from tests.scripted_ui import ScriptedConsole
from tests.synthetic_session import START_NS, header, live_records, tick, write_log

pytestmark = pytest.mark.untimed


def judged(
    *answers: str, measured_s: float | None = 40.0, marks: Marks | None = None
) -> tuple[Verdict, list[str]]:
    """The verdict from these answers, each of which is used, and what was said meanwhile."""
    person = ScriptedConsole(*answers)
    verdict = ask_verdict(person, TrialConfig(), marks or Marks(measured_s))
    assert not person.answers
    return verdict, person.said


def test_answers_that_make_no_sense_are_asked_for_again() -> None:
    verdict, said = judged("maybe", "y", "-1", "1.5", "100", "²", "2", "", "y", "y")
    assert verdict == Verdict(completed=True, success=True, drops=2, completion_time_s=40.0)
    assert len(said) == 6


def test_what_was_not_completed_has_no_time_and_no_success() -> None:
    verdict, _ = judged("n", "1")
    assert verdict == Verdict(completed=False, success=False, drops=1)


def test_success_against_the_rules_is_not_even_asked_for() -> None:
    verdict, said = judged("y", "3", "y")
    assert (verdict.success, said) == (False, ["Not a success by the rules: more than 2 drops."])
    verdict, said = judged("y", "0", "y", measured_s=90.5)
    assert (verdict.success, said) == (False, ["Not a success by the rules: later than 90 s."])


def test_within_the_rules_the_experimenter_decides() -> None:
    assert judged("y", "0", "y", "n")[0].success is False
    assert judged("y", "0", "y", "y")[0].success is True


def test_without_a_measured_time_it_is_asked_for() -> None:
    verdict, said = judged("y", "0", "nan", "0", "121", "x", "45,5", "y", measured_s=None)
    assert verdict.completion_time_s == 45.5
    assert len(said) == 4


def test_a_measured_time_that_is_wrong_or_beyond_the_limit_is_replaced() -> None:
    assert judged("y", "0", "n", "50", "y")[0].completion_time_s == 50
    assert judged("y", "0", "60", "y", measured_s=130.0)[0].completion_time_s == 60


def test_what_was_marked_in_the_trial_needs_only_enter() -> None:
    marks = Marks(40.0, drops=2, placed=True)
    verdict, _ = judged("", "", "y", "y", marks=marks)
    assert verdict == Verdict(completed=True, success=True, drops=2, completion_time_s=40.0)
    verdict, _ = judged("n", "1", marks=marks)
    assert verdict == Verdict(completed=False, success=False, drops=1)


def test_what_was_not_marked_has_to_be_answered() -> None:
    verdict, said = judged("", "y", "", "0", "y", "y")
    assert (verdict.drops, len(said)) == (0, 2)


@pytest.mark.parametrize(
    ("facts", "drops", "placed"),
    [
        ({}, None, False),
        ({DROPS_FACT: "0"}, 0, False),
        ({DROPS_FACT: "3", PLACED_FACT: "yes"}, 3, True),
        ({DROPS_FACT: "many"}, None, False),
    ],
)
def test_marks_are_facts_of_the_log(facts: dict[str, str], drops: int | None, placed: bool) -> None:
    record = log(2.0, (9.0,))
    record.facts.update(facts)
    assert marks_of(record) == Marks(completion_time_s(record), drops, placed)


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


def test_the_time_is_from_the_first_engagement_to_the_last_opening() -> None:
    found = completion_time_s(log(2.0, (1.0, 5.0, 9.0)))
    assert 6.89 < found < 7.01  # ticks of 100 ms


def test_without_engagement_or_opening_there_is_no_time() -> None:
    assert completion_time_s(log(None, (5.0,))) is None
    assert completion_time_s(log(2.0, ())) is None
    assert completion_time_s(log(2.0, (1.0,))) is None  # opened before the trial began


def log_in(folder: Path) -> None:
    """A log of two seconds without its packets."""
    records = live_records(2.0, video_bytes=100)
    kept = (one for one in records if not isinstance(one, PacketRecord))
    write_log(folder / "session.mcap", kept)


def test_the_time_is_measured_from_the_log_where_there_is_one(tmp_path: Path) -> None:
    assert marks_in(tmp_path) == Marks()
    log_in(tmp_path)
    assert marks_in(tmp_path) == Marks()  # the arm was never engaged in that session

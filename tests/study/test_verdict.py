"""The verdict: answers that fit each other and the rules."""

from __future__ import annotations

import pytest

from tams_app.config import TrialConfig
from tams_app.questions import TerminalQuestions
from tams_app.study.plan import Verdict
from tams_app.study.verdict import ask_verdict
from tests.scripted_ui import ScriptedConsole

pytestmark = pytest.mark.untimed


def judged(*answers: str, measured_s: float | None = 40.0) -> tuple[Verdict, list[str]]:
    """The verdict from these answers; each of them is used."""
    person = ScriptedConsole(*answers)
    verdict = ask_verdict(TerminalQuestions(person), TrialConfig(), measured_s)
    assert not person.answers
    return verdict, person.said


def test_answers_that_make_no_sense_are_asked_for_again() -> None:
    verdict, said = judged("maybe", "Yes", "-1", "1.5", "100", "²", "2", "y", "", "y")
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


def test_without_a_measured_time_he_is_asked_for_it() -> None:
    verdict, said = judged("y", "0", "nan", "0", "121", "x", "45,5", "y", measured_s=None)
    assert verdict.completion_time_s == 45.5
    assert len(said) == 4


def test_a_measured_time_that_is_wrong_or_beyond_the_limit_is_replaced() -> None:
    assert judged("y", "0", "n", "50", "y")[0].completion_time_s == 50
    assert judged("y", "0", "60", "y", measured_s=130.0)[0].completion_time_s == 60

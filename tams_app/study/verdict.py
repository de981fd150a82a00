"""Asking an experimenter what became of a trial, until the answers fit each other and the rules."""

from __future__ import annotations

from tams_app.config import TrialConfig
from tams_app.questions import Questions
from tams_app.study.plan import Verdict

MAX_DROPS = 99


def ask_verdict(talk: Questions, rules: TrialConfig, measured_s: float | None) -> Verdict:
    """Completed, drops, time and success; `measured_s` is the time that the log tells.

    Success that the rules exclude is not accepted; a completion within the rules may still be
    judged no success (the block was placed wrongly), and is asked for.
    """
    completed = talk.yes(f"Was the block placed within {rules.limit_s:g} s?")
    drops = talk.whole_number("How many drops?", MAX_DROPS)
    if not completed:
        return Verdict(completed=False, success=False, drops=drops)
    time_s = _completion_time(talk, rules, measured_s)
    obstacle = _obstacle(rules, drops, time_s)
    if obstacle:
        talk.say(f"Not a success by the rules: {obstacle}.")
        return Verdict(completed=True, success=False, drops=drops, completion_time_s=time_s)
    success = talk.yes("Was it placed correctly (a success)?")
    return Verdict(completed=True, success=success, drops=drops, completion_time_s=time_s)


def _completion_time(talk: Questions, rules: TrialConfig, measured_s: float | None) -> float:
    """The log's time if the experimenter takes it, else the one he gives."""
    if measured_s is not None and 0 < measured_s <= rules.limit_s:
        question = f"The gripper opened last {measured_s:.1f} s after the start. Take that time?"
        if talk.yes(question):
            return measured_s
    return talk.seconds("How many seconds from the start to the placing?", rules.limit_s)


def _obstacle(rules: TrialConfig, drops: int, time_s: float) -> str:
    if drops > rules.max_drops:
        return f"more than {rules.max_drops} drops"
    if time_s > rules.success_within_s:
        return f"later than {rules.success_within_s:g} s"
    return ""

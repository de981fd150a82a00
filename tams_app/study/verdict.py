"""The verdict on a trial with a person: what its log has of it, and what the experimenter says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.prompt import Confirm, FloatPrompt, IntPrompt, InvalidResponse

from tams_app.config import TrialConfig
from tams_app.printing import Console
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Phase
from tams_app.study.plan import Verdict
from tams_app.task import judge
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

DROPS_FACT, PLACED_FACT = "drops_counted", "placed_marked"
MAX_DROPS = 99


@dataclass(frozen=True, slots=True)
class Marks:
    """The trial's marks before the experimenter is asked.

    time_s: completion time. drops: None if none was counted. placed: whether the trial was ended by
    the key for that.
    """

    time_s: float | None = None
    drops: int | None = None
    placed: bool = False


def marks_in(folder: Path) -> Marks:
    """Of a trial's folder, which may have no log."""
    path = folder / LOG_NAME
    return marks_of(read_log(path)) if path.is_file() else Marks()


def marks_of(log: SessionLog) -> Marks:
    """The marks in a log."""
    counted = log.facts.get(DROPS_FACT, "")
    drops = min(int(counted), MAX_DROPS) if counted.isdecimal() else None
    return Marks(completion_time_s(log), drops, PLACED_FACT in log.facts)


def completion_time_s(log: SessionLog) -> float | None:
    """From the first engagement to the last opening of the gripper.

    None where the arm was never engaged or the gripper not opened after that. Whether the block
    was placed by that opening only a person can say.
    """
    engaged_ns = min(
        (tick.finished_ns for tick in log.ticks if tick.arming == ArmingState.ENGAGED.value),
        default=None,
    )
    if engaged_ns is None:
        return None
    opened_ns = [
        change.t_ns
        for change in log.phases
        if change.phase is Phase.RELEASE and change.t_ns > engaged_ns
    ]
    return round((max(opened_ns) - engaged_ns) / NS_PER_S, 3) if opened_ns else None


def ask_verdict(console: Console, rules: TrialConfig, marks: Marks) -> Verdict:
    """Completed, drops, time and success, asked until the answers fit each other and the rules.

    What was marked is what Enter answers. A success that the rules exclude is not accepted; a
    completion within the rules may still be no success (the block was placed wrongly), and is
    asked for.
    """
    question = f"Was the block placed within {rules.limit_s:g} s?"
    marked: Any = marks.placed or ...  # none: an answer is asked for
    completed = Confirm.ask(question, default=marked, console=console)
    drops = _drops(console, marks.drops)
    if not completed:
        return Verdict(completed=False, success=False, drops=drops)
    time_s = _completion_time(console, rules, marks.time_s)
    obstacle = _obstacle(drops, time_s)
    if obstacle:
        console.print(f"Not a success by the rules: {obstacle}.")
    success = not obstacle and Confirm.ask("Was it placed correctly (a success)?", console=console)
    return Verdict(completed=True, success=success, drops=drops, completion_time_s=time_s)


def _drops(console: Console, counted: int | None) -> int:
    possible = [str(number) for number in range(MAX_DROPS + 1)]
    marked: Any = ... if counted is None else counted
    return IntPrompt.ask(
        "How many drops?", choices=possible, show_choices=False, default=marked, console=console
    )


def _completion_time(console: Console, rules: TrialConfig, measured_s: float | None) -> float:
    """The log's time if the experimenter takes it, else the one they give."""
    if measured_s is not None and 0 < measured_s <= rules.limit_s:
        question = f"The gripper opened last {measured_s:.1f} s after the start. Take that time?"
        if Confirm.ask(question, console=console):
            return measured_s

    class Seconds(FloatPrompt):
        def process_response(self, value: str) -> float:
            seconds = super().process_response(value.replace(",", "."))
            if not 0 < seconds <= rules.limit_s:
                raise InvalidResponse(f"More than 0 s and at most {rules.limit_s:g} s, please.")
            return seconds

    return Seconds.ask("How many seconds from the start to the placing?", console=console)


def _obstacle(drops: int, time_s: float) -> str:
    if drops > judge.MAX_DROPS:
        return f"more than {judge.MAX_DROPS} drops"
    if time_s > judge.SUCCESS_WITHIN_S:
        return f"later than {judge.SUCCESS_WITHIN_S:g} s"
    return ""

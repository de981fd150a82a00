"""The verdict on a trial that no simulator judged: the log's time, the experimenter's answers."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.prompt import Confirm, FloatPrompt, IntPrompt, InvalidResponse

from tams_app.config import TrialConfig
from tams_app.recording import SessionLog, read_log
from tams_app.records import Phase
from tams_app.study.plan import Verdict
from tams_app.study.runner import LOG_NAME
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

MAX_DROPS = 99


def measured_time_s(folder: Path) -> float | None:
    """The completion time that a trial's log tells, None without a log."""
    path = folder / LOG_NAME
    return completion_time_s(read_log(path)) if path.is_file() else None


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


def ask_verdict(console: Console, rules: TrialConfig, measured_s: float | None) -> Verdict:
    """Completed, drops, time and success, asked until the answers fit each other and the rules.

    `measured_s` is the time that the log tells. A success that the rules exclude is not accepted; a
    completion within the rules may still be no success (the block was placed wrongly), and is
    asked for.
    """
    completed = Confirm.ask(f"Was the block placed within {rules.limit_s:g} s?", console=console)
    possible = [str(number) for number in range(MAX_DROPS + 1)]
    drops = IntPrompt.ask("How many drops?", choices=possible, show_choices=False, console=console)
    if not completed:
        return Verdict(completed=False, success=False, drops=drops)
    time_s = _completion_time(console, rules, measured_s)
    obstacle = _obstacle(rules, drops, time_s)
    if obstacle:
        console.print(f"Not a success by the rules: {obstacle}.", highlight=False)
    success = not obstacle and Confirm.ask("Was it placed correctly (a success)?", console=console)
    return Verdict(completed=True, success=success, drops=drops, completion_time_s=time_s)


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


def _obstacle(rules: TrialConfig, drops: int, time_s: float) -> str:
    if drops > rules.max_drops:
        return f"more than {rules.max_drops} drops"
    if time_s > rules.success_within_s:
        return f"later than {rules.success_within_s:g} s"
    return ""

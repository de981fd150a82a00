"""Guides an experimenter through a study on hardware, trial by trial, and asks for the verdicts.

Neither the experimenter nor the participant is shown the strategy of a trial. The experimenter may
stop at any question, or be interrupted anywhere: the next call goes on from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.prompt import Confirm, FloatPrompt, IntPrompt, InvalidResponse, Prompt

from tams_app.config import Config, TrialConfig
from tams_app.errors import ConfigError, TamsError
from tams_app.printing import Console
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Phase
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import (
    Attempt,
    AttemptState,
    ParticipantState,
    Plan,
    PlannedTrial,
    Verdict,
    void,
)
from tams_app.study.runner import TrialRunner, mark_ended
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


class GuidedRun:
    """One sitting with one participant; the caller holds the study's lock.

    `failed`: it ended at a trial that could not be run.
    """

    def __init__(self, study: StudyFolder, runner: TrialRunner, console: Console) -> None:
        self.failed = False
        self._study = study
        self._runner = runner
        self._console = console
        self._config: Config = study.config()
        self._plan: Plan = study.recover()

    def run(self, participant: str | None = None) -> int:
        """Go through what `participant` has left (None: the first who has any); trials done now.

        ConfigError for a participant who is not, or no longer, part of the study. After Ctrl-C it
        says how to go on and raises KeyboardInterrupt.
        """
        pseudonym = participant or next((trial.participant for trial in self._plan.left), None)
        if pseudonym is None:
            self._print("All trials of this study are done.")
            return 0
        if self._plan.participant(pseudonym).state is not ParticipantState.TAKES_PART:
            raise ConfigError(f"{pseudonym}: was forgotten and takes part no more")
        done = 0
        try:
            while trial := self._next_of(pseudonym):
                if not self._take(trial):
                    break
                done += self._plan.trial(trial.id).is_done
            else:
                self._print(f"{pseudonym} has done all trials. Thank them.")
                return done
        except KeyboardInterrupt:
            self._show_how_to_go_on(pseudonym)
            raise
        except EOFError:
            pass  # the experimenter has left
        self._show_how_to_go_on(pseudonym)
        return done

    def _next_of(self, pseudonym: str) -> PlannedTrial | None:
        mine = (trial for trial in self._plan.left if trial.participant == pseudonym)
        return next(mine, None)

    def _take(self, trial: PlannedTrial) -> bool:
        """One trial from the scene's reset to the verdict, or only the verdict that is due.

        False if the experimenter stops.
        """
        attempt = trial.last
        if attempt is not None and attempt.state is AttemptState.RAN:
            self._print(f"{trial.id} ran to its end before, but has no verdict.")
            self._judge(trial, attempt)
            return True
        if not self._prepare(trial):
            return False
        self._plan, attempt = self._study.new_attempt(self._plan, trial.id)
        folder = self._study.path / attempt.folder
        try:
            self._runner.run(trial, folder)
            mark_ended(folder)
            if not self._study.has_ended(attempt):
                raise TamsError("the trial left no whole summary")
        except TamsError as error:
            return self._fail(trial, attempt, str(error))
        except KeyboardInterrupt:
            reason = "stopped by the experimenter"
            self._settle(trial, attempt, AttemptState.INTERRUPTED, reason=reason)
            raise
        if trial.practice:
            self._settle(trial, attempt, AttemptState.DONE)
            return True
        self._settle(trial, attempt, AttemptState.RAN)
        self._judge(trial, attempt)
        return True

    def _prepare(self, trial: PlannedTrial) -> bool:
        """Ask for the scene to be set back; False if the experimenter wants to stop."""
        mine = [one for one in self._plan.trials if one.participant == trial.participant]
        kind = "practice" if trial.practice else "trial"
        again = ", taken again" if trial.attempts else ""
        mark = 1 + trial.seed % self._config.study.scene_marks
        self._print(
            f"{trial.participant}, {kind} {trial.order} of {len(mine)} ({trial.id}{again})."
        )
        self._print(
            f"Set the scene: block on start mark {mark}, container empty on its mark, gripper "
            "open, trigger released, arm at its ready pose (`run_tams.py home`)."
        )
        return self._choose("Ready?", g="the scene is set: go", s="stop here") == "g"

    def _judge(self, trial: PlannedTrial, attempt: Attempt) -> None:
        void_means = "void: it does not count and is taken again"
        if self._choose(f"{trial.id} has ended.", j="judge it", v=void_means) == "v":
            reason = ""
            while not reason.strip():
                reason = Prompt.ask("Why is it void? The reason is kept", console=self._console)
            self._plan = void(self._plan, trial.id, reason)
            self._study.save(self._plan)
            return
        marks = marks_in(self._study.path / attempt.folder)
        verdict = ask_verdict(self._console, self._config.trial, marks)
        self._settle(trial, attempt, AttemptState.DONE, verdict=verdict)

    def _fail(self, trial: PlannedTrial, attempt: Attempt, reason: str) -> bool:
        self._settle(trial, attempt, AttemptState.FAILED, reason=reason)
        self._print(f"{trial.id} could not be run: {reason}")
        self.failed = self._choose("What now?", a="again", s="stop here") == "s"
        return not self.failed

    def _print(self, text: str) -> None:
        self._console.print(text, soft_wrap=True)

    def _choose(self, question: str, **options: str) -> str:
        """The key of the option that was chosen; the values say what each means."""
        meanings = ", ".join(f"{key} = {meaning}" for key, meaning in options.items())
        text = f"{question} ({meanings})"
        return Prompt.ask(text, choices=[*options], show_choices=False, console=self._console)

    def _show_how_to_go_on(self, pseudonym: str) -> None:
        again = f"study run {self._study.path} --participant {pseudonym}"
        self._print(f"Stopped. `{again}` goes on from here.")

    def _settle(
        self, trial: PlannedTrial, attempt: Attempt, state: AttemptState, **changes: Any
    ) -> None:
        self._plan = self._study.settle(self._plan, trial.id, attempt, state=state, **changes)

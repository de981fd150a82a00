"""Guides an experimenter through a study on hardware, trial by trial.

Neither the experimenter nor the participant is told the strategy of a trial. The experimenter may
stop at any question, or be interrupted anywhere: the next call goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path

from rich.console import Console
from rich.prompt import Prompt

from tams_app.config import Config
from tams_app.errors import ConfigError, TamsError
from tams_app.study.folder import StudyFolder
from tams_app.study.machine import mark_ended
from tams_app.study.plan import Attempt, AttemptState, ParticipantState, Plan, PlannedTrial, void
from tams_app.study.runner import TrialRunner
from tams_app.study.verdict import ask_verdict

MeasureTime = Callable[[Path], float | None]


class _Next(Enum):
    GO_ON = "go on"
    STOP = "stop"


class GuidedRun:
    """One sitting with one participant; the caller holds the study's lock.

    `measure_time` gives the completion time [s] that a trial's folder tells, if any. `failed`: the
    sitting was ended at a trial that could not be run.
    """

    def __init__(
        self,
        study: StudyFolder,
        runner: TrialRunner,
        console: Console,
        measure_time: MeasureTime,
    ) -> None:
        self.failed = False
        self._study = study
        self._runner = runner
        self._console = console
        self._measure_time = measure_time
        self._config: Config = study.config()
        self._plan: Plan = study.recover(study.load())

    def run(self, participant: str | None = None) -> int:
        """Go through what `participant` has left (None: the first who has any); trials done now.

        ConfigError for a participant who is not, or no longer, part of the study. After Ctrl-C it
        says how to go on and raises KeyboardInterrupt.
        """
        pseudonym = participant or self._first_with_trials_left()
        if pseudonym is None:
            self._say("All trials of this study are done.")
            return 0
        if self._plan.participant(pseudonym).state is not ParticipantState.TAKES_PART:
            raise ConfigError(f"{pseudonym}: was forgotten and takes part no more")
        done = 0
        try:
            while trial := self._next_of(pseudonym):
                if self._take(trial) is _Next.STOP:
                    break
                done += self._plan.trial(trial.id).is_done
            else:
                self._say(f"{pseudonym} has done all trials. Thank them.")
                return done
        except KeyboardInterrupt:
            self._tell_how_to_go_on(pseudonym)
            raise
        except EOFError:
            pass  # the experimenter has left
        self._tell_how_to_go_on(pseudonym)
        return done

    def _first_with_trials_left(self) -> str | None:
        return next((trial.participant for trial in self._plan.left), None)

    def _next_of(self, pseudonym: str) -> PlannedTrial | None:
        mine = (trial for trial in self._plan.left if trial.participant == pseudonym)
        return next(mine, None)

    def _take(self, trial: PlannedTrial) -> _Next:
        """One trial from the scene's reset to the verdict; or only the verdict that is due."""
        attempt = trial.last
        if attempt is not None and attempt.state is AttemptState.RAN:
            self._say(f"{trial.id} ran to its end before, but has no verdict.")
            self._judge(trial, attempt)
            return _Next.GO_ON
        if not self._prepare(trial):
            return _Next.STOP
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
            self._settle(trial, attempt, AttemptState.INTERRUPTED, "stopped by the experimenter")
            raise
        if trial.practice:
            self._settle(trial, attempt, AttemptState.DONE)
            return _Next.GO_ON
        ran = self._settle(trial, attempt, AttemptState.RAN)
        self._judge(trial, ran)
        return _Next.GO_ON

    def _prepare(self, trial: PlannedTrial) -> bool:
        """Ask for the scene to be set back; False if the experimenter wants to stop."""
        mine = [one for one in self._plan.trials if one.participant == trial.participant]
        kind = "practice" if trial.practice else "trial"
        again = ", taken again" if trial.attempts else ""
        mark = 1 + trial.seed % self._config.study.scene_marks
        self._say(f"{trial.participant}, {kind} {trial.order} of {len(mine)} ({trial.id}{again}).")
        self._say(
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
        measured_s = self._measure_time(self._study.path / attempt.folder)
        verdict = ask_verdict(self._console, self._config.trial, measured_s)
        judged = attempt.model_copy(update={"verdict": verdict})
        self._settle(trial, judged, AttemptState.DONE)

    def _fail(self, trial: PlannedTrial, attempt: Attempt, reason: str) -> _Next:
        self._settle(trial, attempt, AttemptState.FAILED, reason)
        self._say(f"{trial.id} could not be run: {reason}")
        self.failed = self._choose("What now?", a="again", s="stop here") == "s"
        return _Next.STOP if self.failed else _Next.GO_ON

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _choose(self, question: str, **options: str) -> str:
        """The key of the option that was chosen; the values say what each means."""
        meanings = ", ".join(f"{key} = {meaning}" for key, meaning in options.items())
        text = f"{question} ({meanings})"
        return Prompt.ask(text, choices=[*options], show_choices=False, console=self._console)

    def _tell_how_to_go_on(self, pseudonym: str) -> None:
        again = f"study run {self._study.path} --participant {pseudonym}"
        self._say(f"Stopped. `{again}` goes on from here.")

    def _settle(
        self, trial: PlannedTrial, attempt: Attempt, state: AttemptState, reason: str = ""
    ) -> Attempt:
        settled = attempt.model_copy(update={"state": state, "reason": reason})
        self._plan = self._plan.with_attempt(trial.id, settled)
        self._study.save(self._plan)
        return settled

"""Guides an experimenter through a study on hardware, trial by trial.

Neither he nor the participant is told the strategy of a trial. He may stop at any question, or be
interrupted anywhere: the next call goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path

from tams_app.config import Config
from tams_app.errors import ConfigError, TamsError
from tams_app.questions import Questions
from tams_app.study.folder import StudyFolder
from tams_app.study.machine import mark_ended
from tams_app.study.plan import Attempt, AttemptState, ParticipantState, Plan, PlannedTrial, void
from tams_app.study.runner import TrialRunner, TrialSpec
from tams_app.study.verdict import ask_verdict

MeasureTime = Callable[[Path], float | None]


class _Next(Enum):
    GO_ON = "go on"
    STOP = "stop"


class GuidedRun:
    """One sitting with one participant; the caller holds the study's lock.

    `measure_time` gives the completion time [s] that a trial's folder tells, if any.
    """

    def __init__(
        self,
        study: StudyFolder,
        runner: TrialRunner,
        talk: Questions,
        measure_time: MeasureTime,
    ) -> None:
        self._study = study
        self._runner = runner
        self._talk = talk
        self._measure_time = measure_time
        self._config: Config = study.config()
        self._plan: Plan = study.recover(study.load())

    def run(self, participant: str | None = None) -> int:
        """Go through what `participant` has left (None: the first who has any); trials done now.

        ConfigError if he is not, or no longer, part of the study.
        """
        pseudonym = participant or self._first_with_trials_left()
        if pseudonym is None:
            self._talk.say("All trials of this study are done.")
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
                self._talk.say(f"{pseudonym} has done all his trials. Thank him.")
                return done
        except (EOFError, KeyboardInterrupt):
            pass
        again = f"study run {self._study.path} --participant {pseudonym}"
        self._talk.say(f"Stopped. `{again}` goes on from here.")
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
            self._talk.say(f"{trial.id} ran to its end before, but has no verdict.")
            self._judge(trial, attempt)
            return _Next.GO_ON
        if not self._prepare(trial):
            return _Next.STOP
        self._plan, attempt = self._study.new_attempt(self._plan, trial.id)
        folder = self._study.path / attempt.folder
        try:
            self._runner.run(TrialSpec.of(trial), folder)
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
        self._talk.say(
            f"{trial.participant}, {kind} {trial.order} of {len(mine)} ({trial.id}{again})."
        )
        self._talk.say(
            f"Set the scene: block on start mark {mark}, container empty on its mark, gripper "
            "open, trigger released, arm at its ready pose (`run_tams.py home`)."
        )
        options = {"g": "the scene is set: go", "s": "stop here"}
        return self._talk.choice("Ready?", options) == "g"

    def _judge(self, trial: PlannedTrial, attempt: Attempt) -> None:
        options = {"j": "judge it", "v": "void: it does not count and is taken again"}
        if self._talk.choice(f"{trial.id} has ended.", options) == "v":
            reason = self._talk.text("Why is it void?")
            self._plan = void(self._plan, trial.id, reason)
            self._study.save(self._plan)
            return
        measured_s = self._measure_time(self._study.path / attempt.folder)
        verdict = ask_verdict(self._talk, self._config.trial, measured_s)
        judged = attempt.model_copy(update={"verdict": verdict})
        self._settle(trial, judged, AttemptState.DONE)

    def _fail(self, trial: PlannedTrial, attempt: Attempt, reason: str) -> _Next:
        self._settle(trial, attempt, AttemptState.FAILED, reason)
        self._talk.say(f"{trial.id} could not be run: {reason}")
        options = {"a": "again", "s": "stop here"}
        return _Next.GO_ON if self._talk.choice("What now?", options) == "a" else _Next.STOP

    def _settle(
        self, trial: PlannedTrial, attempt: Attempt, state: AttemptState, reason: str = ""
    ) -> Attempt:
        settled = attempt.model_copy(update={"state": state, "reason": reason})
        self._plan = self._plan.with_attempt(trial.id, settled)
        self._study.save(self._plan)
        return settled

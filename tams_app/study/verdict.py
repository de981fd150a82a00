"""Asking an experimenter what became of a trial, until the answers fit each other and the rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tams_app.config import TrialConfig
from tams_app.study.plan import Verdict

MAX_DROPS = 99
Ask = Callable[[str], str]
Say = Callable[[str], None]
_YES, _NO = ("y", "yes"), ("n", "no")


@dataclass(frozen=True, slots=True)
class Conversation:
    """How the experimenter is spoken to: `ask` shows a question and gives the answer typed."""

    ask: Ask
    say: Say

    def yes(self, question: str) -> bool:
        """Ask until the answer is yes or no."""
        while True:
            answer = self.ask(f"{question} [y/n] ").strip().lower()
            if answer in (*_YES, *_NO):
                return answer in _YES
            self.say("Please answer y or n.")

    def choice(self, question: str, options: dict[str, str]) -> str:
        """Ask until the answer is a key of `options`, which say what each means."""
        listed = ", ".join(f"{key} = {meaning}" for key, meaning in options.items())
        while True:
            answer = self.ask(f"{question} ({listed}) ").strip().lower()
            if answer in options:
                return answer
            self.say(f"Please answer one of {', '.join(options)}.")

    def text(self, question: str) -> str:
        """Ask until there is an answer."""
        while not (answer := self.ask(f"{question} ").strip()):
            self.say("Please say something: it is kept with the data.")
        return answer

    def whole_number(self, question: str, largest: int) -> int:
        """Ask until the answer is a whole number from 0 to `largest`."""
        while True:
            answer = self.ask(f"{question} ").strip()
            if answer.isdecimal() and answer.isascii() and int(answer) <= largest:
                return int(answer)
            self.say(f"Please give a whole number from 0 to {largest}.")

    def seconds(self, question: str, largest: float) -> float:
        """Ask until the answer is a time from 0 to `largest` seconds."""
        while True:
            try:
                answer = float(self.ask(f"{question} ").strip().replace(",", "."))
            except ValueError:
                answer = math.nan
            if 0 < answer <= largest:
                return answer
            self.say(f"Please give seconds, more than 0 and at most {largest:g}.")


def ask_verdict(talk: Conversation, rules: TrialConfig, measured_s: float | None) -> Verdict:
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


def _completion_time(talk: Conversation, rules: TrialConfig, measured_s: float | None) -> float:
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

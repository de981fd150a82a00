"""Questions to a person, each asked until the answer makes sense."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

Ask = Callable[[str], str]
Say = Callable[[str], None]
_YES, _NO = ("y", "yes"), ("n", "no")


@dataclass(frozen=True, slots=True)
class Conversation:
    """How a person is spoken to: `ask` shows a question and gives the answer typed."""

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

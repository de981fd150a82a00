"""Questions to a person at the terminal, each asked until the answer is valid (rich.prompt)."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

from rich.console import Console
from rich.prompt import Confirm, FloatPrompt, IntPrompt, Prompt, PromptBase
from rich.text import Text

T = TypeVar("T")


class Questions(Protocol):
    """What a guided procedure says to a person and asks of them."""

    def say(self, text: str) -> None:
        """Print one or more sentences."""

    def yes(self, question: str) -> bool:
        """Ask until the answer is yes or no."""

    def choice(self, question: str, options: dict[str, str]) -> str:
        """Ask until the answer is a key of `options`, which say what each means."""

    def text(self, question: str) -> str:
        """Ask until there is an answer."""

    def whole_number(self, question: str, largest: int) -> int:
        """Ask until the answer is a whole number from 0 to `largest`."""

    def seconds(self, question: str, largest: float) -> float:
        """Ask until the answer is a time above 0 and up to `largest` seconds."""


class TerminalQuestions:
    """Questions at a console; EOFError once its input is closed."""

    def __init__(self, console: Console) -> None:
        self.console = console

    def say(self, text: str) -> None:
        # as Text nothing in it is markup
        self.console.print(Text(text), soft_wrap=True)

    def yes(self, question: str) -> bool:
        return self._ask(_YesOrNo, question)

    def choice(self, question: str, options: dict[str, str]) -> str:
        listed = ", ".join(f"{key} = {meaning}" for key, meaning in options.items())
        return self._ask(
            _Line,
            f"{question} ({listed})",
            choices=list(options),
            show_choices=False,
            case_sensitive=False,
        )

    def text(self, question: str) -> str:
        while not (answer := self.line(question)):
            self.say("Please say something: it is kept with the data.")
        return answer

    def whole_number(self, question: str, largest: int) -> int:
        while not 0 <= (number := self._ask(_WholeNumber, question)) <= largest:
            self.say(f"Please give a whole number from 0 to {largest}.")
        return number

    def seconds(self, question: str, largest: float) -> float:
        while not 0 < (time_s := self._ask(_Seconds, question)) <= largest:
            self.say(f"Please give seconds, more than 0 and at most {largest:g}.")
        return time_s

    def line(self, question: str) -> str:
        """One line, stripped; it may be empty."""
        return self._ask(_Line, question)

    def _ask(self, prompt: type[PromptBase[T]], question: str, **how: Any) -> T:
        answer: T = prompt.ask(Text(question), console=self.console, **how)
        return answer


class _Line(Prompt):
    prompt_suffix = " "


class _YesOrNo(Confirm):
    prompt_suffix = " "
    validate_error_message = "Please answer y or n."

    def process_response(self, value: str) -> bool:
        answer = value.strip().lower()
        return super().process_response({"yes": "y", "no": "n"}.get(answer, answer))


class _WholeNumber(IntPrompt):
    prompt_suffix = " "


class _Seconds(FloatPrompt):
    prompt_suffix = " "

    def process_response(self, value: str) -> float:
        return super().process_response(value.replace(",", "."))

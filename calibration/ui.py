"""The terminal that a wizard talks through: sentences, questions, a live area, the Enter key."""

from __future__ import annotations

import sys
from io import StringIO
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from rich.console import Console, RenderableType
from rich.live import Live
from rich.prompt import Confirm, Prompt, PromptBase
from rich.table import Table
from rich.text import Text

from tams_app.console.terminal import Key, TerminalKeys
from tams_app.errors import ConfigError

T = TypeVar("T")
_TEXT_WIDTH = 100


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


class WizardUI(Questions, Protocol):
    """A context manager; leaving it restores the terminal."""

    @property
    def attended(self) -> bool:
        """Whether there is a person who can be asked; if not, questions raise ConfigError."""

    def line(self, question: str) -> str:
        """Ask for one line, which may be empty."""

    def show(self, live: RenderableType) -> None:
        """Display the current measurement in place of what was shown before."""

    def pressed(self) -> bool:
        """Whether Enter was pressed since the last call; False without a terminal."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class TerminalUI(TerminalQuestions):
    """The terminal that the command was started from, or the file or pipe in its place."""

    def __init__(self, console: Console | None = None) -> None:
        super().__init__(console or Console())
        self._keys = TerminalKeys()
        self._live: Live | None = None

    @property
    def attended(self) -> bool:
        # a process may be started without any standard input
        return sys.stdin is not None and sys.stdin.isatty() and self.console.is_terminal

    def show(self, live: RenderableType) -> None:
        if not self.console.is_terminal:
            return  # a file would get every state of it
        if self._live is None:
            display = Live(
                console=self.console, auto_refresh=False, redirect_stdout=False, transient=True
            )
            try:
                display.start()
            except BaseException:  # Ctrl-C: a display that has only half started cannot be stopped
                self.console.show_cursor(True)
                raise
            self._live = display
        self._live.update(live, refresh=True)

    def pressed(self) -> bool:
        if not self._keys.active:
            self._keys.open()
        return self._keys.active and Key.CONFIRM in self._keys.read(0.0)

    def _ask(self, prompt: type[PromptBase[T]], question: str, **how: Any) -> T:
        self._restore()
        if not self.attended:
            raise ConfigError(
                "there is no terminal to ask at: start it from one, or look at the command's "
                "--help for how to run it unattended"
            )
        try:
            return super()._ask(prompt, question, **how)
        except EOFError as error:
            raise ConfigError("the terminal was closed before the question was answered") from error

    def _restore(self) -> None:
        """Remove the live area and let the terminal read whole lines."""
        live, self._live = self._live, None
        try:
            if live is not None:
                live.stop()
        finally:
            self._keys.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()


def plain_table(first: str, *others: str, gap: int = 2) -> Table:
    """A table without lines, its first column left and the others right."""
    table = Table(box=None, padding=(0, gap))
    table.add_column(first)
    for name in others:
        table.add_column(name, justify="right")
    return table


def as_text(*parts: RenderableType) -> str:
    """Tables as text that stays, the same on every terminal and in a file."""
    # no markup: `[s]` is a unit, not a style
    console = Console(
        width=_TEXT_WIDTH, file=StringIO(), no_color=True, markup=False, highlight=False
    )
    with console.capture() as capture:
        for part in parts:
            console.print(part)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())

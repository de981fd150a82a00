"""The kit of all wizards: the terminal and tables."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from io import StringIO
from typing import Any, Self, TypeAlias, TypeVar

from rich.console import RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.prompt import Confirm, Prompt, PromptBase
from rich.table import Table
from rich.text import Text

from tams_app.errors import ConfigError
from tams_app.faces.commands import Command
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console

T = TypeVar("T")
Progress: TypeAlias = Callable[[str, float], None]
"""Takes what is under way, and the part of it done: `WizardUI.progress`."""
_TEXT_WIDTH = 100


def quiet(_doing: str, _part: float) -> None:
    """Progress that is not shown."""


class _Line(Prompt):
    prompt_suffix = " "


class _YesOrNo(Confirm):
    prompt_suffix = " "
    validate_error_message = "Please answer y or n."

    def process_response(self, value: str) -> bool:
        answer = value.strip().lower()
        return super().process_response({"yes": "y", "no": "n"}.get(answer, answer))


class WizardUI:
    """The terminal that the command was started from, or the file or pipe in its place.

    A context manager; leaving it restores the terminal. Unless it is `attended`, every question
    raises ConfigError.
    """

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console()
        self._keys = TerminalKeys()
        self._live: Live | None = None

    @property
    def attended(self) -> bool:
        """Whether there is a person who can be asked."""
        # a process may be started without any standard input
        return sys.stdin is not None and sys.stdin.isatty() and self.console.is_terminal

    def print(self, text: str) -> None:
        """Print one or more sentences."""
        # as Text nothing in it is markup
        self.console.print(Text(text), soft_wrap=True)

    def yes(self, question: str, **how: bool) -> bool:
        """Ask until the answer is yes or no; Enter alone is `default`, if one is given."""
        return self._ask(_YesOrNo, question, show_default=False, **how)

    def choice(self, question: str, options: dict[str, str]) -> str:
        """Ask until the answer is a key of `options`, which say what each means."""
        listed = ", ".join(
            key if meaning == key else f"{key} = {meaning}" for key, meaning in options.items()
        )
        return self._ask(
            _Line,
            f"{question} ({listed})",
            choices=list(options),
            show_choices=False,
            case_sensitive=False,
        )

    def line(self, question: str) -> str:
        """Ask for one line; it may be empty."""
        return self._ask(_Line, question)

    def show(self, live: RenderableType) -> None:
        """Display the current measurement in place of what was shown before."""
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

    def progress(self, doing: str, part: float) -> None:
        """Display what is under way, and the part of it done [0..1]."""
        bar = ProgressBar(total=1.0, completed=part, width=40)
        self.show(table([(doing, bar, f"{part:.0%}")]))

    def pressed(self) -> bool:
        """Whether Enter was pressed since the last call; False without a terminal."""
        if not self._keys.active:
            self._keys.open()
        return self._keys.active and Command.CONFIRM in self._keys.read(0.0)

    def _ask(self, prompt: type[PromptBase[T]], question: str, **how: Any) -> T:
        self._restore()
        if not self.attended:
            raise ConfigError(
                "there is no terminal to ask at: start it from one, or look at the command's "
                "--help for how to run it unattended"
            )
        try:
            answer: T = prompt.ask(Text(question), console=self.console, **how)
        except KeyboardInterrupt:
            # interrupted in the middle of printing, rich would hold back all later output
            self.console._buffer_index = 0
            raise
        except EOFError as error:
            raise ConfigError("the terminal was closed before the question was answered") from error
        return answer

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

    def __exit__(self, *_error: object) -> None:
        self._restore()


def bar(share: float, width: int = 20) -> str:
    """A bar that is full at 1."""
    full = min(width, max(0, round(share * width)))
    return "█" * full + "░" * (width - full)


def table(
    rows: Iterable[Sequence[RenderableType]], heads: Sequence[str] = (), title: str | None = None
) -> Table:
    """A table without lines; under `heads` its first column is left and the others are right."""
    made = Table(
        box=None, padding=(0, 2), title=title, title_justify="left", show_header=bool(heads)
    )
    for number, head in enumerate(heads):
        made.add_column(head, justify="right" if number else "left")
    for row in rows:
        made.add_row(*row)
    return made


def as_text(*parts: RenderableType) -> str:
    """Tables as text that stays, the same on every terminal and in a file."""
    # no markup: `[s]` is a unit, not a style
    console = Console(width=_TEXT_WIDTH, file=StringIO(), no_color=True)
    with console.capture() as capture:
        for part in parts:
            console.print(part)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())

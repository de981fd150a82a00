"""Where a wizard and a person meet: sentences, questions, a live area, and the Enter key."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from tams_app.console.terminal import Key, TerminalKeys
from tams_app.conversation import Conversation
from tams_app.errors import ConfigError


class Desk(Protocol):
    """A context: leave it to give the terminal back."""

    @property
    def attended(self) -> bool:
        """Whether somebody is there to be asked."""

    @property
    def conversation(self) -> Conversation:
        """To ask with; ConfigError where nobody is there to answer."""

    def say(self, text: str) -> None:
        """One or more sentences, which stay."""

    def show(self, picture: RenderableType) -> None:
        """What is measured at this moment, in place of what was shown before."""

    def pressed(self) -> bool:
        """Has Enter been pressed since this was last asked? False without a terminal."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class TerminalDesk:
    """The terminal that the command was started from, or the file or pipe in its place."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._keys = TerminalKeys()
        self._live: Live | None = None
        self.conversation = Conversation(self._ask, self.say)

    @property
    def attended(self) -> bool:
        # a process may be started without any standard input
        return sys.stdin is not None and sys.stdin.isatty() and self._console.is_terminal

    def say(self, text: str) -> None:
        # as Text nothing in it is markup, while the live area below it still may have some
        self._console.print(Text(text), soft_wrap=True)

    def show(self, picture: RenderableType) -> None:
        if not self._console.is_terminal:
            return  # a file would get every state of it
        if self._live is None:
            live = Live(
                console=self._console, auto_refresh=False, redirect_stdout=False, transient=True
            )
            try:
                live.start()
            except BaseException:  # Ctrl-C: what has only half begun cannot be stopped
                self._console.show_cursor(True)
                raise
            self._live = live
        self._live.update(picture, refresh=True)

    def pressed(self) -> bool:
        if not self._keys.active:
            self._keys.open()
        return self._keys.active and Key.CONFIRM in self._keys.read(0.0)

    def _ask(self, question: str) -> str:
        self._rest()
        if not self.attended:
            raise ConfigError(
                "nobody is at the terminal to answer: start it from one, or look at the command's "
                "--help for how to run it unattended"
            )
        try:
            return self._console.input(Text(question))
        except EOFError as error:
            raise ConfigError("the terminal was closed before the question was answered") from error

    def _rest(self) -> None:
        """Take the live area away and let the terminal read whole lines."""
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
        self._rest()


class PlayedDesk:
    """A desk with somebody who answers from a list, for tests and for simulated people."""

    def __init__(self, answers: list[str] | None = None, presses: int = 0) -> None:
        """`presses`: how often `pressed` says yes."""
        self._answers = list(answers or [])
        self._presses = presses
        self.said: list[str] = []
        self.shown: list[RenderableType] = []
        self.conversation = Conversation(self._ask, self.say)

    @property
    def attended(self) -> bool:
        return bool(self._answers)

    def say(self, text: str) -> None:
        self.said.append(text)

    def show(self, picture: RenderableType) -> None:
        self.shown.append(picture)

    def pressed(self) -> bool:
        if self._presses == 0:
            return False
        self._presses -= 1
        return True

    def _ask(self, question: str) -> str:
        self.said.append(question)
        if not self._answers:
            raise ConfigError("nobody is at the terminal to answer")
        return self._answers.pop(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing to give back."""

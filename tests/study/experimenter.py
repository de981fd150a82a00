"""An experimenter at the keyboard, as a console that answers from a list."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console


class Experimenter(Console):
    """Answers from a list; when it is used up, the experimenter has left (end of input)."""

    def __init__(self, *answers: str) -> None:
        super().__init__(file=io.StringIO(), width=250)
        self.answers = list(answers)
        self.asked: list[str] = []

    def input(self, prompt: Any = "", **_: Any) -> str:
        self.asked.append(str(prompt))
        if not self.answers:
            raise EOFError
        return self.answers.pop(0)

    @property
    def text(self) -> str:
        """All that was printed."""
        assert isinstance(self.file, io.StringIO)
        return self.file.getvalue()

    @property
    def said(self) -> list[str]:
        """The lines that were printed."""
        return self.text.splitlines()

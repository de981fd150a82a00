"""A person at the terminal who answers from a list; the prompts are the real ones."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console, RenderableType

from calibration.kit import WizardUI

CTRL_C = "\x03"


class ScriptedConsole(Console):
    """Gives the answers in turn, then the end of the input; keeps what is printed and asked."""

    def __init__(self, *answers: str) -> None:
        super().__init__(file=io.StringIO(), width=200)
        self.answers = list(answers)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.transcript: list[str] = []  # both, in order

    @property
    def text(self) -> str:
        """All that was printed, as it was shown."""
        assert isinstance(self.file, io.StringIO)
        return self.file.getvalue()

    def print(self, *objects: object, **options: Any) -> None:
        super().print(*objects, **options)
        self.said.append(str(objects[0]))
        self.transcript.append(str(objects[0]))

    def input(self, prompt: object = "", **_: object) -> str:
        self.asked.append(str(prompt))
        self.transcript.append(str(prompt))
        if not self.answers:
            raise EOFError
        answer = self.answers.pop(0)
        if answer == CTRL_C:
            raise KeyboardInterrupt
        return answer


class ScriptedUI(WizardUI):
    """Attended as long as there are answers left."""

    def __init__(self, answers: list[str] | None = None, presses: int = 0) -> None:
        """`presses`: how often `pressed` says yes."""
        self.console: ScriptedConsole
        super().__init__(ScriptedConsole(*(answers or [])))
        self._presses = presses
        self.said = self.console.transcript
        self.shown: list[RenderableType] = []

    @property
    def attended(self) -> bool:
        return bool(self.console.answers)

    def show(self, live: RenderableType) -> None:
        self.shown.append(live)

    def pressed(self) -> bool:
        if self._presses == 0:
            return False
        self._presses -= 1
        return True

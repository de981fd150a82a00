"""Marking the phases of a trial on its replay as text; each mark is kept at once."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from calibration.phases.marks import (
    Mark,
    add_mark,
    phase_named,
    read_marks,
    without_mark,
    write_marks,
)
from calibration.phases.replay import Replay, strip
from calibration.ui import WizardUI
from tams_app.errors import ConfigError

HELP = """\
  Enter        a second on            b            a second back
  +0.3  -0.3   by so many seconds     12.4         to 12.4 s
  g            to where the gripper is told to open or close next
  ALIGN        it begins here         12.4 ALIGN   it begins at 12.4 s    (any short form: al)
  -            nothing counts from here on; so it is before the first mark
  undo         forget the mark before the cursor
  q            enough for this trial; what is marked is kept
  ?            this list once more"""
_STEP_S = 1.0
_ROUND = 3  # milliseconds


class Marking:
    """One trial's marks and the cursor over it; `handle` takes one command."""

    def __init__(self, replay: Replay, marks: list[Mark]) -> None:
        self.replay = replay
        self.marks = marks
        self.cursor_s = marks[-1].t_s if marks else 0.0

    def handle(self, command: str) -> bool:
        """Carry out a command; whether the marks have changed. ConfigError says what is wrong."""
        words = command.split()
        if not words:
            self._go(self.cursor_s + _STEP_S)
        elif words == ["b"]:
            self._go(self.cursor_s - _STEP_S)
        elif words == ["g"]:
            self._go(self._next_edge_s())
        elif words == ["undo"]:
            return self._undo()
        elif len(words) == 1 and _number(words[0]) is not None:
            relative = words[0][0] in "+-"
            self._go(float(words[0]) + (self.cursor_s if relative else 0.0))
        else:
            return self._mark(words)
        return False

    def figure(self) -> str:
        """Where the cursor is."""
        return strip(self.replay, self.marks, self.cursor_s)

    def _mark(self, words: list[str]) -> bool:
        at_s = _number(words[0]) if len(words) == 2 else self.cursor_s
        if at_s is None or len(words) > 2:
            raise ConfigError(f"{' '.join(words)!r} is none of these:\n{HELP}")
        mark = Mark(round(at_s, _ROUND), phase_named(words[-1]))
        self.marks = add_mark(self.marks, mark, self.replay.last_s)
        self._go(mark.t_s)
        return True

    def _undo(self) -> bool:
        before = [mark for mark in self.marks if mark.t_s <= self.cursor_s]
        if not before:
            raise ConfigError("there is no mark before the cursor")
        self.marks = without_mark(self.marks, before[-1])
        return True

    def _next_edge_s(self) -> float:
        edges = np.flatnonzero(np.diff(self.replay.closed)) + 1
        later = self.replay.t_s[edges][self.replay.t_s[edges] > self.cursor_s + 0.5 * 10**-_ROUND]
        if not len(later):
            raise ConfigError("the gripper is told nothing more after this")
        return float(later[0])

    def _go(self, t_s: float) -> None:
        last_s = math.floor(self.replay.last_s * 10**_ROUND) / 10**_ROUND  # still in the log
        self.cursor_s = round(min(max(t_s, 0.0), last_s), _ROUND)


def mark_trial(ui: WizardUI, replay: Replay, path: Path) -> list[Mark]:
    """Ask for marks until told that it is enough; they are kept at `path` after each command."""
    marks = read_marks(path, replay.last_s) if path.is_file() else []
    marking = Marking(replay, marks)
    ui.say(f"\n{replay.name}: {replay.last_s:.1f} s, {len(marks)} marks so far\n{HELP}")
    while True:
        ui.say(marking.figure())
        command = ui.line(f"{marking.cursor_s:.2f} s> ").strip()
        if command.lower() == "q":
            return marking.marks
        if command == "?":
            ui.say(HELP)
            continue
        try:
            if marking.handle(command):
                write_marks(path, marking.marks)
        except ConfigError as error:
            ui.say(f"Not understood: {error}")


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if np.isfinite(value) else None

"""Marking the phases of a trial on its replay as text; each mark is kept at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.phases.marks import (
    Mark,
    add_mark,
    phase_named,
    read_marks,
    without_mark,
    write_marks,
)
from calibration.phases.trials import Floats, Motion
from calibration.ui import WizardUI
from tams_app.errors import ConfigError
from tams_app.records import Tick

COLUMNS = 72
COLUMN_S = 0.1
CURSOR_COLUMN = 24
FASTEST_MM_S = 120.0
FASTEST_VERTICAL_MM_S = 80.0
_BARS = " ▁▂▃▄▅▆▇█"
_NAME_WIDTH = 22
_RULE_S = 1.0

Text: TypeAlias = NDArray[np.str_]


@dataclass(frozen=True, slots=True)
class Replay:
    """What is shown of a trial of n ticks: smoothed speeds [mm/s], height of the tool [mm] and the
    gripper, shape (n,) each; no inferred phase."""

    name: str
    t_s: Floats
    speed: Floats
    vertical: Floats
    height: Floats
    closed: NDArray[np.bool_]

    @property
    def last_s(self) -> float:
        return float(self.t_s[-1])


def replay_of(motion: Motion, ticks: Sequence[Tick]) -> Replay:
    """A motion and the logged ticks it was made of."""
    speed, vertical, closed, _ = zip(*motion.inputs, strict=True)
    height = [tick.arm.tcp.position[2] if tick.arm is not None else np.nan for tick in ticks]
    return Replay(
        motion.name,
        motion.t_s,
        1000.0 * np.array(speed),
        1000.0 * np.array(vertical),
        1000.0 * np.array(height),
        np.array([bool(command) for command in closed]),
    )


def strip(replay: Replay, marks: Sequence[Mark], cursor_s: float) -> str:
    """The seconds around `cursor_s`, a tenth of a second to a column, as lines of text."""
    t_s: Floats = cursor_s + (np.arange(COLUMNS, dtype=np.float64) - CURSOR_COLUMN) * COLUMN_S
    place = np.searchsorted(replay.t_s, t_s, side="right") - 1
    inside = (t_s >= 0.0) & (t_s <= replay.last_s)
    place = np.clip(place, 0, len(replay.t_s) - 1)
    low, high = float(np.nanmin(replay.height)), float(np.nanmax(replay.height))
    lines = {
        "": _ruler(t_s, inside),
        f"speed 0..{FASTEST_MM_S:.0f} mm/s": _bars(replay.speed[place] / FASTEST_MM_S),
        f"up 0..{FASTEST_VERTICAL_MM_S:.0f} mm/s": _bars(
            replay.vertical[place] / FASTEST_VERTICAL_MM_S
        ),
        f"down 0..{FASTEST_VERTICAL_MM_S:.0f} mm/s": _bars(
            -replay.vertical[place] / FASTEST_VERTICAL_MM_S
        ),
        f"height {low:.0f}..{high:.0f} mm": _bars(
            (replay.height[place] - low) / max(high - low, 1.0)
        ),
        "gripper closed": np.where(replay.closed[place], "█", "·"),
        "marked": _marked(t_s, marks),
    }
    rows = [
        f"{name:>{_NAME_WIDTH}} {''.join(np.where(inside, row, ' '))}".rstrip()
        for name, row in lines.items()
    ]
    return "\n".join([*rows, " " * (_NAME_WIDTH + 1 + CURSOR_COLUMN) + f"^ {cursor_s:.2f} s"])


def _bars(part: Floats) -> Text:
    """A bar of eighths for each part of 1; empty for less than nothing and for what is unknown."""
    eighths = np.clip(np.ceil(np.nan_to_num(part) * 8 - 0.5), 0, 8).astype(int)
    drawn: Text = np.array(list(_BARS))[eighths]
    return drawn


def _ruler(t_s: Floats, inside: NDArray[np.bool_]) -> Text:
    """The whole seconds, where they are."""
    row = [" "] * COLUMNS
    for second in np.arange(np.ceil(t_s[0]), t_s[-1], _RULE_S):
        column = int(np.searchsorted(t_s, second - 1e-6))
        figures = f"|{second:.0f}"
        if inside[column] and column + len(figures) <= COLUMNS:
            row[column : column + len(figures)] = figures
    return np.array(row)


def _marked(t_s: Floats, marks: Sequence[Mark]) -> Text:
    """A bar where a phase begins, and its name as far as there is room."""
    row = ["·"] * COLUMNS
    for number, mark in enumerate(marks):
        end_s = marks[number + 1].t_s if number + 1 < len(marks) else np.inf
        first, last = (int(np.searchsorted(t_s, edge - 1e-6)) for edge in (mark.t_s, end_s))
        begun = first > 0 or mark.t_s >= t_s[0]
        text = ("|" if begun else " ") + mark.name
        width = last - first
        row[first:last] = text[:width].ljust(width)
    return np.array(row[:COLUMNS])


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

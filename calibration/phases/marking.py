"""Marking the phases of a trial on its replay as text; each mark is kept at once.

The marks are in `phases.csv` in a log's folder, with the columns t_s (since the session started, as
in summary.json) and phase, in order of time; `-` for the phase means that nothing counts from there
on, as before the first mark.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.phases.trials import CODE, NOT_COUNTED, Codes, Floats, Motion
from calibration.ui import WizardUI
from tams_app.errors import ConfigError
from tams_app.outputs import write_file
from tams_app.records import Phase, Tick

FILE_NAME = "phases.csv"
NOTHING = "-"
_COLUMNS = ["t_s", "phase"]


@dataclass(frozen=True, slots=True, order=True)
class Mark:
    """From `t_s` [s] on it is `phase`; None: no phase of the task."""

    t_s: float
    phase: Phase | None

    @property
    def name(self) -> str:
        return self.phase.value if self.phase is not None else NOTHING


def phase_named(name: str) -> Phase | None:
    """The phase, in whatever case, or any unambiguous beginning; None for `-`.

    ConfigError lists the names.
    """
    wanted = name.strip().upper().replace("-", "_")
    if name.strip() == NOTHING:
        return None
    found = [phase for phase in Phase if phase.value.startswith(wanted)]
    exact = [phase for phase in found if phase.value == wanted]
    if len(exact or found) != 1 or not wanted:
        names = ", ".join(phase.value for phase in Phase)
        raise ConfigError(f"{name!r} is no phase; they are {names}, and {NOTHING} for none")
    return (exact or found)[0]


def add_mark(marks: Sequence[Mark], mark: Mark, last_s: float) -> list[Mark]:
    """`marks` with `mark` in its place; one at the same time is replaced.

    ConfigError if it is outside the log, which ends at `last_s`, or changes nothing.
    """
    if not 0.0 <= mark.t_s <= last_s:
        raise ConfigError(f"{mark.t_s:g} s is outside the log, which lasts {last_s:.1f} s")
    others = [other for other in marks if other.t_s != mark.t_s]
    before = [other for other in others if other.t_s < mark.t_s]
    after = [other for other in others if other.t_s > mark.t_s]
    for neighbour in (*before[-1:], *after[:1]):
        if neighbour.phase is mark.phase:
            raise ConfigError(f"{mark.name} is marked at {neighbour.t_s:g} s already")
    return [*before, mark, *after]


def without_mark(marks: Sequence[Mark], gone: Mark) -> list[Mark]:
    """`marks` without `gone`; nor does a phase begin anew that now goes on from before it."""
    kept: list[Mark] = []
    for mark in marks:
        if mark != gone and (not kept or mark.phase is not kept[-1].phase):
            kept.append(mark)
    return kept


def labels_from(marks: Sequence[Mark], t_s: Floats) -> Codes:
    """The marked phase of every tick, shape (n,)."""
    codes = [NOT_COUNTED, *(NOT_COUNTED if m.phase is None else CODE[m.phase] for m in marks)]
    place = np.searchsorted([mark.t_s for mark in marks], t_s, side="right")
    return np.array(codes, np.int8)[place]


def write_marks(path: Path, marks: Iterable[Mark]) -> None:
    """Keep them at `path`; what was there stays whole until they are. LogError if it fails."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    writer.writerows((f"{mark.t_s:.3f}", mark.name) for mark in marks)
    write_file(path, text.getvalue())


def read_marks(path: Path, last_s: float) -> list[Mark]:
    """The marks at `path`, of a log that ends at `last_s`; ConfigError with line and reason."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    rows = [(number, row) for number, row in enumerate(csv.reader(lines), start=1) if row]
    if not rows or [cell.strip() for cell in rows[0][1]] != _COLUMNS:
        raise ConfigError(f"{path}: line 1: must be {','.join(_COLUMNS)}")
    marks: list[Mark] = []
    for number, row in rows[1:]:
        where = f"{path}: line {number}"
        mark = _mark_of(row, where)
        if marks and mark.t_s <= marks[-1].t_s:
            raise ConfigError(
                f"{where}: {mark.t_s:g} s does not come after {marks[-1].t_s:g} s: sort the marks"
            )
        try:
            marks = add_mark(marks, mark, last_s)
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from error
    return marks


def _mark_of(row: Sequence[str], where: str) -> Mark:
    if len(row) != len(_COLUMNS):
        raise ConfigError(f"{where}: has {len(row)} cells, not {len(_COLUMNS)}")
    try:
        t_s = float(row[0])
    except ValueError:
        t_s = math.nan
    if not math.isfinite(t_s):
        raise ConfigError(f"{where}: t_s is {row[0]!r}, not a time in seconds")
    try:
        return Mark(t_s, phase_named(row[1]))
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error


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

"""The marks of where the phases of a recorded trial begin, and making them in a replay.

They are in `phases.csv` in a log's folder, with the columns t_s (since the session started, as in
summary.json) and phase, in order of time; `-` for the phase means that nothing counts from there
on, as before the first mark.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tams_app.errors import ConfigError
from tams_app.outputs import write_file
from tams_app.records import Phase

FILE_NAME = "phases.csv"
NOTHING = "-"
_COLUMNS = ["t_s", "phase"]
_ROUND = 3  # milliseconds


@dataclass(frozen=True, slots=True)
class Mark:
    """The begin of `phase` at `t_s` [s]; None: no phase of the task."""

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
        if not 0.0 <= mark.t_s <= last_s:
            raise ConfigError(
                f"{where}: {mark.t_s:g} s is outside the log, which lasts {last_s:.1f} s"
            )
        if marks and mark.t_s <= marks[-1].t_s:
            raise ConfigError(
                f"{where}: {mark.t_s:g} s does not come after {marks[-1].t_s:g} s: sort the marks"
            )
        if marks and mark.phase is marks[-1].phase:
            raise ConfigError(f"{where}: {mark.name} is marked at {marks[-1].t_s:g} s already")
        marks.append(mark)
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


class Marking:
    """The marks of one log; each change is on the disk before it is shown.

    LogError if the disk refuses; the marks before are kept there.
    """

    def __init__(self, path: Path, last_s: float) -> None:
        """Goes on with the marks at `path`, if there are any; ConfigError as of `read_marks`.

        `last_s`: the end of the log, after which there is nothing to mark.
        """
        self._path = path
        self._last_s = math.floor(last_s * 10**_ROUND) / 10**_ROUND
        self.marks = read_marks(path, last_s) if path.is_file() else []

    def begin(self, phase: Phase | None, t_s: float) -> str:
        """Let a phase begin there (None: none), in place of a mark at the same time; a sentence.

        Where the same phase was marked to begin next, it begins earlier now.
        """
        mark = Mark(round(min(max(t_s, 0.0), self._last_s), _ROUND), phase)
        others = [other for other in self.marks if other.t_s != mark.t_s]
        if not self._keep(sorted([*others, mark], key=lambda one: one.t_s)):
            return f"it is {mark.name} at {mark.t_s:.2f} s already"
        return f"marked: {mark.name} from {mark.t_s:.2f} s on"

    def undo(self, t_s: float) -> str:
        """Remove the last mark before that moment or at it; a sentence."""
        last = self.mark_at(t_s)
        if last is None:
            return "there is no mark before this"
        self._keep([mark for mark in self.marks if mark is not last])
        return f"not marked any more: {last.name} at {last.t_s:.2f} s"

    def mark_at(self, t_s: float) -> Mark | None:
        """The mark that holds at that moment; None before the first."""
        holding = [mark for mark in self.marks if mark.t_s <= t_s + 0.5 / 10**_ROUND]
        return holding[-1] if holding else None

    def _keep(self, marks: Iterable[Mark]) -> bool:
        """Keep these but for those that begin what goes on anyway; whether that changes any."""
        kept: list[Mark] = []
        for mark in marks:
            if not kept or mark.phase is not kept[-1].phase:
                kept.append(mark)
        changed = kept != self.marks
        if changed:
            write_marks(self._path, kept)
            self.marks = kept
        return changed

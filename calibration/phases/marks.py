"""An experimenter's marks: `phases.csv` in a log's folder says when each phase began.

Columns t_s (since the session started, as in summary.json) and phase, in order of time; `-` for the
phase means that nothing counts from there on, as before the first mark.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.phases.trials import CODE, NOT_COUNTED, Codes, Floats
from tams_app.errors import ConfigError
from tams_app.records import Phase
from tams_app.study.folder import write_atomically

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
    write_atomically(path, text.getvalue())


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
        mark = _mark(row, where)
        if marks and mark.t_s <= marks[-1].t_s:
            raise ConfigError(
                f"{where}: {mark.t_s:g} s does not come after {marks[-1].t_s:g} s: sort the marks"
            )
        try:
            marks = add_mark(marks, mark, last_s)
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from error
    return marks


def _mark(row: Sequence[str], where: str) -> Mark:
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

"""`phases`: Algorithm 1 over a table of speeds."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from tams_app.config import Config, PhasesConfig
from tams_app.console.options import Override, overriding
from tams_app.errors import ConfigError
from tams_app.outputs import write_file
from tams_app.policy.phases import PhaseTracker, SmoothedSpeed

COLUMNS = ("t_s", "vx_mm_s", "vy_mm_s", "vz_mm_s", "gripper")
ADDED_COLUMNS = ("phase", "reason")


@overriding(
    "file out no_smoothing v_eps_mm_s vz_min_mm_s align_dwell_s pre_release_dwell_s preset config",
    {
        name: Override(f"policy.phases.{name}")
        for name in ("v_eps_mm_s", "vz_min_mm_s", "align_dwell_s", "pre_release_dwell_s")
    },
)
def phases(
    settings: Config,
    file: Annotated[Path, typer.Argument(metavar="FILE.csv")],
    out: Annotated[Path | None, typer.Option(help="Default: standard output.")] = None,
    no_smoothing: Annotated[
        bool, typer.Option("--no-smoothing", help="The speeds are already smoothed.")
    ] = False,
) -> None:
    """Label the task phases in a table of speeds (Algorithm 1).

    Its columns: t_s, vx_mm_s, vy_mm_s, vz_mm_s, gripper (0 open, 1 closed).
    """
    thresholds = settings.policy.phases
    if out is not None and out.exists() and file.exists() and out.samefile(file):
        raise ConfigError(f"--out: {out} is the table that is read: give another file")
    smoothing_s = 0.0 if no_smoothing else thresholds.smoothing_ms / 1000
    labelled = label_phases(_text(file), str(file), thresholds, smoothing_s)
    if out is None:
        typer.echo(labelled, nl=False)
    else:
        write_file(out, labelled)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text") from error


@dataclass(frozen=True, slots=True)
class _Row:
    t_s: float
    speed_mm_s: float
    vertical_mm_s: float
    closed: bool


def label_phases(text: str, name: str, thresholds: PhasesConfig, smoothing_s: float) -> str:
    """The CSV `text` with the columns phase and reason added.

    `smoothing_s` is the EMA's time constant; 0 takes the speeds exactly as they are.
    Raises ConfigError naming `name`, line and reason.
    """
    header, records = _read(text, name)
    rows = list(_rows(records, name))
    output = io.StringIO()
    writer = csv.DictWriter(output, [*header, *ADDED_COLUMNS], lineterminator="\n")
    writer.writeheader()
    for (_, record), labels in zip(records, _label(rows, thresholds, smoothing_s), strict=True):
        writer.writerow({**record, **labels})
    return output.getvalue()


def _read(text: str, name: str) -> tuple[Sequence[str], list[tuple[int, dict[str, str]]]]:
    """The header, and each record with the number of the line it ends on."""
    reader = csv.DictReader(io.StringIO(text))
    try:
        header = reader.fieldnames or ()
        _check_header(header, name)
        return header, [(reader.line_num, record) for record in reader]
    except csv.Error as error:
        # the DictReader's own line_num does not count the line that fails
        raise ConfigError(f"{name}: line {reader.reader.line_num}: {error}") from error


def _check_header(header: Sequence[str], name: str) -> None:
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        raise ConfigError(f"{name}: lacks the column {missing[0]}; needed are {', '.join(COLUMNS)}")
    repeated = [column for column in header if header.count(column) > 1]
    if repeated:
        raise ConfigError(f"{name}: has the column {repeated[0]!r} more than once")
    added = [column for column in ADDED_COLUMNS if column in header]
    if added:
        raise ConfigError(f"{name}: has a column {added[0]} already; remove it or rename it")


def _label(
    rows: Iterable[_Row], thresholds: PhasesConfig, smoothing_s: float
) -> Iterator[dict[str, str]]:
    tracker, smoothed = PhaseTracker(thresholds), SmoothedSpeed(smoothing_s)
    last_s: float | None = None
    for row in rows:
        period_s = 0.0 if last_s is None else row.t_s - last_s
        last_s = row.t_s
        smoothed.smooth(row.speed_mm_s, row.vertical_mm_s, period_s)
        decision = tracker.step(
            speed=smoothed.speed / 1000,  # divided as the thresholds are: equal stays equal
            vertical_speed=smoothed.vertical_speed / 1000,
            closed=row.closed,
            period_s=period_s,
        )
        yield {"phase": decision.phase.value, "reason": decision.reason}


def _rows(records: list[tuple[int, dict[str, str]]], name: str) -> Iterator[_Row]:
    if not records:
        raise ConfigError(f"{name}: has no rows")
    last_s = -math.inf
    for line, record in records:
        where = f"{name}: line {line}"
        if None in record or None in record.values():
            raise ConfigError(f"{where}: has not as many cells as the header")
        t_s, *velocity_mm_s = (_number(record[column], column, where) for column in COLUMNS[:4])
        if t_s < last_s:
            raise ConfigError(f"{where}: t_s goes back from {last_s:g} to {t_s:g}")
        last_s = t_s
        gripper = record["gripper"].strip()
        if gripper not in ("0", "1"):
            raise ConfigError(f"{where}: gripper is {gripper!r}, not 0 (open) or 1 (closed)")
        yield _Row(t_s, math.hypot(*velocity_mm_s), velocity_mm_s[2], gripper == "1")


def _number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(f"{where}: {column} is {text!r}, not a finite number")
    return value

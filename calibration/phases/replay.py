"""A trial as lines of text: speed, height and gripper around a moment, with the marks so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.phases.marks import Mark
from calibration.phases.trials import Floats, Motion
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
    gripper, shape (n,) each; no phase that anybody inferred."""

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

"""What the person sees while the hand moves, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rich.console import JustifyMethod
from rich.table import Table
from rich.text import Text

from calibration.frame.buttons import ButtonFinding
from calibration.frame.capture import Held
from calibration.frame.fit import FrameFit
from calibration.frame.sources import SIX_DIRECTIONS, Move
from calibration.frame.stroke import ASKED_LENGTH_M, MIN_SAMPLES, RefusedError, Stroke, fit_line
from calibration.frame.touches import TouchFit
from hw.openvr.components import ROLES, ComponentReading
from tams_app.records import ControllerSample

_ARROWS = {"+x": "⊙", "−x": "⊗", "+y": "←", "−y": "→", "+z": "↑", "−z": "↓"}
_MEANING = {
    "+x": "away from the robot's base",
    "−x": "towards the robot's base",
    "+y": "to the robot's left",
    "−y": "to the robot's right",
    "+z": "up",
    "−z": "down",
}
_BAR = 20
PARTS = {
    "trigger": "the trigger (deadman and clutch)",
    "grip": "the grip (translation or orientation)",
    "a": "A (closes the gripper; X on a left Focus 3, the pad's near edge on a wand)",
    "b": "B (opens the gripper; Y on a left Focus 3, the pad's far edge on a wand)",
    "menu": "the menu (confirms, stops; on a Focus 3 or an Index press the stick)",
}


def meaning(move: Move) -> str:
    """A robot's direction in words, as seen from the robot."""
    return _MEANING[move.name]


def stroke_line(axis: int, held: Held | None, sample: ControllerSample) -> Table:
    """Travel, straightness and number of samples of the stroke under way."""
    table = Table(box=None, show_header=False)
    table.add_row("controller", sample.status.value)
    if held is None:
        table.add_row("trigger", "up: squeeze it to begin")
        return table
    try:
        line = fit_line(Stroke(axis, held.positions))
    except RefusedError:  # too few samples to say anything yet
        table.add_row("trigger", "held: move")
        return table
    table.add_row("travel", f"{_bar(line.length_m / ASKED_LENGTH_M)} {1000 * line.length_m:.0f} mm")
    table.add_row("straightness", f"{_bar(line.straightness)} {line.straightness:.0%}")
    table.add_row("samples", f"{_bar(line.samples / MIN_SAMPLES)} {line.samples}")
    return table


def touch_line(number: int, held: Held | None, sample: ControllerSample) -> Table:
    """Whether the touch is under way."""
    table = Table(box=None, show_header=False)
    table.add_row("controller", sample.status.value)
    samples = 0 if held is None else len(held.poses)
    table.add_row(f"point {number}", f"{samples} samples" if samples else "squeeze to begin")
    return table


def button_table(reading: ComponentReading | None, role: str, found: Mapping[str, str]) -> Table:
    """Every component with how far it is pressed, and the part it was found to play."""
    table = _titled(f"Press and let go {PARTS[role]}", "component", "pressed", "plays")
    roles = {path: role for role, path in found.items()}
    for path, value in (reading.values if reading else {}).items():
        table.add_row(path, _bar(value), roles.get(path, ""))
    return table


def finding_table(finding: ButtonFinding) -> Table:
    """What each part moves, and what was believed."""
    table = _titled(f"Buttons of {finding.controller_type}", "part", "found", "in force", "")
    for role in ROLES:
        verdict = "put right" if role in finding.wrong else "as it was"
        table.add_row(role, finding.paths[role], finding.believed[role], verdict)
    return table


def compass_table(asked: Move | None, lit: Move | None, right: Mapping[Move, bool]) -> Table:
    """The six directions: which one is asked for, which one the arm would take now."""
    table = Table(box=None, show_header=False)
    for move in SIX_DIRECTIONS:
        style = "bold black on green" if move == lit else "" if move == asked else "dim"
        table.add_row(
            "▶" if move == asked else " ",
            Text(f" {_ARROWS[move.name]} {move.name} ", style),
            meaning(move),
            {True: "✓", False: "✗", None: ""}[right.get(move)],
        )
    return table


def result_table(fit: FrameFit | TouchFit) -> Table:
    """How each stroke or touch fits the frame."""
    return _stroke_table(fit) if isinstance(fit, FrameFit) else _touch_table(fit)


def _stroke_table(fit: FrameFit) -> Table:
    """Each stroke: how it went, and how far it is from the axis it was made for."""
    columns = ("length, mm", "samples", "straight", "scatter, mm", "off axis, °", "")
    table = _titled("The strokes", "stroke", *columns, justify="right")
    for stroke in fit.strokes:
        line = stroke.line
        table.add_row(
            line.name,
            f"{1000 * line.length_m:.0f}",
            str(line.samples),
            f"{line.straightness:.1%}",
            f"{1000 * line.scatter_m:.1f}",
            f"{stroke.angle_deg:.1f}",
            "" if stroke.used else "left out",
        )
    return table


def _touch_table(fit: TouchFit) -> Table:
    """Each touch: how far the frame of the others misses it."""
    table = _titled("The touches", "point", "missed by the others, mm", "", justify="right")
    for number, miss in enumerate(fit.misses_mm):
        table.add_row(str(number + 1), f"{miss:.1f}", "left out" if number in fit.left_out else "")
    return table


def _titled(title: str, *columns: str, justify: JustifyMethod = "left") -> Table:
    table = Table(title=title, title_justify="left", box=None)
    for name in columns:
        table.add_column(name, justify=justify)
    return table


def _bar(share: float) -> str:
    full = int(np.clip(round(share * _BAR), 0, _BAR))
    return "█" * full + "░" * (_BAR - full)

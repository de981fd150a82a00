"""From fits to what is written, whether it may be, and the figure of it."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from rich.table import Table

from calibration.frame.buttons import ButtonFinding
from calibration.frame.fit import BAD_DEG, GOOD_DEG, FrameFit, Matrix, stands_upright, turn_deg
from calibration.frame.sources import SIX_DIRECTIONS, Move
from calibration.frame.stroke import AXES, RefusedError
from calibration.store import Calibration
from calibration.ui import plain_table
from tams_app.config import Config, HandConfig, MappingConfig
from tams_app.config.calibrated import read_calibrated
from tams_app.report.plots import GRID, INK, WIDE_IN, new_figure, save_figure, styled

KIND = "frame"
_DIGITS = 9  # the configuration wants orthonormal to 1e-6
_COLOURS = ("#c0392b", "#27ae60", "#2471a3")  # x, y, z, as robots are drawn
_PLANES = ((0, 1), (0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class FrameResult:
    """All that one run of the wizard found out."""

    frame: FrameFit
    source: str  # in words
    buttons: ButtonFinding | None = None
    lit: Mapping[Move, bool] | None = None  # None: not tried
    true_rotation: Matrix | None = None


def rows(rotation: Matrix) -> tuple[tuple[float, float, float], ...]:
    """As the configuration has it."""
    rounded = np.round(rotation, _DIGITS) + 0.0  # no negative zeros
    return tuple((float(row[0]), float(row[1]), float(row[2])) for row in rounded)


def hand_with(hand: HandConfig, frame: FrameFit) -> HandConfig:
    """The hand's mapping with the new frame."""
    return hand.model_copy(update={"rotation": rows(frame.rotation)})


def mapped(config: Config, buttons: ButtonFinding | None) -> Config:
    """The configuration with the buttons as they were found."""
    if buttons is None:
        return config
    mapping: dict[Any, MappingConfig] = dict(config.controller.mapping)
    mapping[buttons.controller_type] = MappingConfig(**buttons.paths)
    controller = config.controller.model_copy(update={"mapping": mapping})
    return config.model_copy(update={"controller": controller})


def result_table(fit: FrameFit) -> Table:
    """How each stroke fits the frame."""
    strokes = [
        (
            one.line.name,
            f"{1000 * one.line.length_m:.0f}",
            str(one.line.samples),
            f"{one.line.straightness:.1%}",
            f"{1000 * one.line.scatter_m:.1f}",
            f"{one.angle_deg:.1f}",
            "" if one.used else "left out",
        )
        for one in fit.strokes
    ]
    heads = ("stroke", "length, mm", "samples", "straight", "scatter, mm", "off axis, °", "")
    return plain_table(heads, strokes, "The strokes")


def remarks(config: Config, frame: FrameFit) -> list[str]:
    """What a person should know of the result, one sentence each."""
    off = turn_deg(frame.rotation, np.array(config.hand.rotation))
    lines = [
        f"The frame is right within {frame.error_bound_deg:.1f}° (95 %, as far as the "
        "measurements' disagreement tells); the rotation in force differs from it by "
        f"{off:.1f}°.",
        f"Residual {frame.residual_mm:.1f} mm, condition {frame.condition:.2f} (1 is best).",
        *(f"Note: {remark}." for remark in frame.left_out),
    ]
    if not stands_upright(frame.rotation):
        lines.append(
            "With this frame the robot's z axis does not point up: right for an arm that hangs or "
            "leans, else two strokes were reversed or axes were taken for one another."
        )
    return lines


def doubt(frame: FrameFit) -> str:
    """Why the result needs a second thought, "" if it does not; RefusedError if it is no use."""
    bound = frame.error_bound_deg
    if bound > BAD_DEG:
        raise RefusedError(
            f"The frame may be off by {bound:.1f}°, and more than {BAD_DEG:g}° is no use: "
            f"{_advice(frame)}.",
        )
    if bound > GOOD_DEG:
        return f"The frame may be off by {bound:.1f}°, more than {GOOD_DEG:g}°: {_advice(frame)}."
    return ""


def _advice(frame: FrameFit) -> str:
    worst = max((s for s in frame.strokes if s.used), key=lambda stroke: stroke.angle_deg)
    return (
        f"a {worst.line.name} stroke is {worst.angle_deg:.1f}° off its axis; move along "
        "something straight, make longer strokes, or more of them with --rounds"
    )


def calibration(
    config: Config, outcome: FrameResult, before: Path | None, simulated: bool
) -> Calibration:
    """What is written. A part that was not measured now stays as `before`, the file in force."""
    changes: dict[str, Any] = {}
    if before is not None:
        changes = deepcopy(read_calibrated(before, KIND).changes)
    rotation = [list(row) for row in rows(outcome.frame.rotation)]
    changes["hand"] = changes.get("hand", {}) | {"rotation": rotation}
    buttons = outcome.buttons
    if buttons is not None and (buttons.wrong or config.controller.mapping):
        mapping = changes.setdefault("controller", {}).setdefault("mapping", {})
        mapping[buttons.controller_type] = dict(buttons.paths)
    return Calibration(KIND, changes, outcome.source, _quality(config, outcome), simulated)


def _quality(config: Config, outcome: FrameResult) -> dict[str, Any]:
    frame, lit, buttons = outcome.frame, outcome.lit, outcome.buttons
    quality: dict[str, Any] = {
        "error_bound_95_deg": round(frame.error_bound_deg, 3),
        "residual_mm": round(frame.residual_mm, 3),
        "condition": round(frame.condition, 3),
        "changed_by_deg": round(turn_deg(frame.rotation, np.array(config.hand.rotation)), 3),
    }
    used = [stroke for stroke in frame.strokes if stroke.used]
    quality["off_axis_deg"] = [f"{one.line.name} {one.angle_deg:.2f}" for one in used]
    quality["samples"] = sum(one.line.samples for one in used)
    quality["left_out"] = list(frame.left_out)
    if lit is not None:
        quality["directions_lit"] = f"{sum(lit.values())} of {len(SIX_DIRECTIONS)}"
    if buttons is not None:
        quality["buttons_put_right"] = list(buttons.wrong)
    if outcome.true_rotation is not None:
        quality["true_error_deg"] = round(turn_deg(frame.rotation, outcome.true_rotation), 3)
    return quality


@styled
def save_fit(fit: FrameFit, path: Path) -> None:
    """How the strokes lie in the frame that they make, as a figure."""
    figure = new_figure(WIDE_IN, 3.8)
    axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
    for place, plane in zip(axes[:2], _PLANES, strict=True):
        _draw_directions(place, fit, plane)
    _draw_angles(axes[2], fit)
    figure.suptitle(
        f"Frame from {len(fit.strokes)} strokes: right within {fit.error_bound_deg:.1f}° (95 %), "
        f"residual {fit.residual_mm:.1f} mm"
    )
    save_figure(figure, path)


def _draw_directions(axes: Axes, fit: FrameFit, plane: tuple[int, int]) -> None:
    """Every stroke from the origin, in the robot's frame, seen onto one plane."""
    for stroke in fit.strokes:
        line = stroke.line
        end = 1000 * line.length_m * (fit.rotation @ line.direction)
        axes.plot(
            [0, end[plane[0]]],
            [0, end[plane[1]]],
            color=_COLOURS[line.axis],
            linewidth=1.6,
            linestyle="-" if stroke.used else ":",
            marker="o",
            markevery=[1],
            markersize=3.5,
        )
    axes.axhline(0, color=GRID, linewidth=0.8, zorder=0)
    axes.axvline(0, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlabel(f"robot {AXES[plane[0]]} [mm]")
    axes.set_ylabel(f"robot {AXES[plane[1]]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")


def _draw_angles(axes: Axes, fit: FrameFit) -> None:
    numbers = np.arange(len(fit.strokes))
    for number, stroke in zip(numbers, fit.strokes, strict=True):
        opacity = 1.0 if stroke.used else 0.3
        axes.bar(number, stroke.angle_deg, color=_COLOURS[stroke.line.axis], alpha=opacity)
    axes.axhline(
        fit.error_bound_deg, color=INK, linestyle="--", linewidth=1, label="error bound (95 %)"
    )
    axes.legend(loc="upper right")
    axes.set_xticks(numbers, [stroke.line.name for stroke in fit.strokes])
    axes.set_ylim(0, 1.25 * max(fit.error_bound_deg, *(s.angle_deg for s in fit.strokes)))
    axes.set_ylabel("off the prompted axis [°]")

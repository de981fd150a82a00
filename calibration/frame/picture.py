"""The fit as a picture: how the strokes or touches lie in the frame that they make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.frame.fit import FrameFit
from calibration.frame.stroke import AXES
from calibration.frame.touches import TouchFit
from tams_app.errors import TamsError

_COLOURS = ("#c0392b", "#27ae60", "#2471a3")  # x, y, z, as robots are drawn
_PLANES = ((0, 1), (0, 2))


def save_picture(fit: FrameFit | TouchFit, path: Path) -> None:
    """Write a PNG; TamsError if the disk refuses."""
    figure = Figure(figsize=(9.6, 3.3), layout="constrained")
    if isinstance(fit, FrameFit):
        axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
        for place, plane in zip(axes[:2], _PLANES, strict=True):
            _draw_directions(place, fit, plane)
        _draw_angles(axes[2], fit)
        subject = f"{len(fit.strokes)} strokes"
    else:
        _draw_misses(figure.subplots(), fit)
        subject = f"{len(fit.misses_mm)} touches"
    figure.suptitle(
        f"Frame from {subject}: right within {fit.error_bound_deg:.1f}° (95 %), "
        f"residual {fit.residual_mm:.1f} mm",
        fontsize=11,
    )
    try:
        figure.savefig(path, dpi=100, format="png")
    except OSError as error:
        raise TamsError(f"{path}: cannot be written: {error.strerror}") from error


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
    axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    axes.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    axes.set_xlabel(f"robot {AXES[plane[0]]} [mm]")
    axes.set_ylabel(f"robot {AXES[plane[1]]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")


def _draw_angles(axes: Axes, fit: FrameFit) -> None:
    numbers = np.arange(len(fit.strokes))
    for number, stroke in zip(numbers, fit.strokes, strict=True):
        axes.bar(
            number,
            stroke.angle_deg,
            color=_COLOURS[stroke.line.axis],
            alpha=1.0 if stroke.used else 0.3,
        )
    axes.axhline(
        fit.error_bound_deg, color="0.2", linestyle="--", linewidth=1, label="error bound (95 %)"
    )
    axes.legend(loc="upper right", frameon=False, fontsize=8)
    axes.set_xticks(numbers, [stroke.line.name for stroke in fit.strokes], fontsize=8)
    axes.set_ylim(0, 1.25 * max(fit.error_bound_deg, *(s.angle_deg for s in fit.strokes)))
    axes.set_ylabel("off the prompted axis [°]")


def _draw_misses(axes: Axes, fit: TouchFit) -> None:
    numbers = np.arange(1, len(fit.misses_mm) + 1)
    shades = ["0.75" if n - 1 in fit.left_out else _COLOURS[2] for n in numbers]
    axes.bar(numbers, fit.misses_mm, color=shades)
    axes.set_xticks(numbers)
    axes.set_xlabel("touch")
    axes.set_ylabel("missed by the others' frame [mm]")

"""`run_tams.py calibrate frame`: buttons, strokes, the fit, a try, and the question."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from calibration.frame.asking import fit_moves, try_six_directions
from calibration.frame.buttons import ButtonFinding, ask_buttons, finding_table
from calibration.frame.fit import (
    BAD_DEG,
    GOOD_DEG,
    BeginAgainError,
    FrameFit,
    Matrix,
    RefusedError,
    stands_upright,
    turn_deg,
)
from calibration.frame.sources import (
    SIX_DIRECTIONS,
    HandSource,
    LiveSetup,
    Move,
)
from calibration.kit import as_text, table
from calibration.options import FrameOptions
from calibration.store import Calibration
from calibration.wizard import Wizard
from tams_app.config import Config, MappingConfig
from tams_app.config.calibrated import read_calibrated
from tams_app.errors import ConfigError
from tams_app.report.plots import INK, PAGE_IN, new_figure, styled
from tams_app.runtime.clock import MonotonicClock

if TYPE_CHECKING:
    from calibration.frame.simulated_person import SimulatedSetup

KIND = "frame"
_DIGITS = 9  # the configuration wants orthonormal to 1e-6
_COLOURS = ("#c0392b", "#27ae60", "#2471a3")  # x, y, z, as robots are drawn
_INTRODUCTION = """\
How does the controller's tracking frame stand to the robot? The robot's x points away from its
base, y to its left, z up. Take the {hand} controller.
{tasks}
At last you try all six directions. The arm is not connected and does not move.
Ctrl-C ends this at any time, and nothing is changed."""
_BUTTONS = "You will press each button once.\n"
_STROKES = """\
You will move it along the robot's axes, at least 200 mm each time, along something straight where
you can."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameResult:
    """All that one run of the wizard found out."""

    frame: FrameFit
    source: str  # in words
    buttons: ButtonFinding | None = None
    lit: Mapping[Move, bool] | None = None  # None: not tried


class FrameWizard(Wizard[FrameOptions]):
    """How the controller's frame stands to the arm's, and which button is which."""

    _outcome: FrameResult | None = None  # once there is a frame that may be kept

    def check(self) -> None:
        self.overrides = {"rig.enabled": True} if self.options.sim else None

    def measure(self) -> Calibration | None:
        options, setup = self.options, self._setup()
        tasks = (_BUTTONS if options.buttons else "") + _STROKES
        self.ui.print(_INTRODUCTION.format(hand=self.config.controller.hand, tasks=tasks))
        if options.sim:
            self.ui.print("A simulated person does all this now.")
        buttons = None
        if options.buttons:
            with setup.buttons() as components:
                buttons = ask_buttons(self.ui, components, self.config)
            self.ui.print(as_text(finding_table(buttons)))
        config = mapped(self.config, buttons)
        with setup.hand(config.controller) as source:
            frame = fit_moves(self.ui, source, config, options.rounds)
            self._show(frame)
            doubt_of(frame)  # what is no use needs no trying
            self._outcome = FrameResult(frame, f"strokes by {setup.description}", buttons)
            self._try(source, self._outcome)
        return self.partial()

    def partial(self) -> Calibration | None:
        if self._outcome is None:
            return None
        before = self.store.in_force(KIND)
        return calibration(self.config, self._outcome, before, self.simulated)

    def drawn(self) -> Figure | None:
        return None if self._outcome is None else fit_figure(self._outcome.frame)

    def _setup(self) -> LiveSetup | SimulatedSetup:
        if self.options.sim:
            from calibration.frame.simulated_person import SimulatedSetup

            return SimulatedSetup(self.config, self.options.seed)
        if self.config.rig.enabled:
            raise ConfigError(
                "this configuration has the simulated rig: add --sim, or give --config with "
                "hardware"
            )
        self.require_person()
        return LiveSetup(self.config, MonotonicClock(), lambda _level, text: self.ui.print(text))

    def _show(self, frame: FrameFit) -> None:
        self.ui.print(as_text(result_table(frame)))
        for remark in remarks(self.config, frame):
            self.ui.print(remark)

    def _try(self, source: HandSource, outcome: FrameResult) -> None:
        """RefusedError unless each direction that was tried lit up."""
        self.ui.print(
            "Now try it: no arm is connected, the table shows where it would go. Move some 200 mm "
            "each time; Enter skips a direction."
        )
        config = mapped(self.config, outcome.buttons)
        turned = {"rotation": rows(outcome.frame.rotation)}
        hand = config.hand.model_copy(update=turned)
        try:
            lit = try_six_directions(self.ui, source, config, hand)
        except BeginAgainError:
            self._outcome = None  # nothing measured before holds
            raise
        self.ui.print(
            f"{sum(lit.values())} of {len(SIX_DIRECTIONS)} directions lit up as asked for."
        )
        self._outcome = replace(outcome, lit=lit)
        if wrong := [one.name for one, is_right in lit.items() if not is_right]:
            self._outcome = None
            raise RefusedError(
                f"Another direction lit up for {', '.join(wrong)}, or none: if you moved as asked, "
                "the frame is wrong; calibrate again."
            )


def rows(rotation: Matrix) -> tuple[tuple[float, float, float], ...]:
    """As the configuration has it."""
    rounded = np.round(rotation, _DIGITS) + 0.0  # no negative zeros
    return tuple((float(row[0]), float(row[1]), float(row[2])) for row in rounded)


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
    return table(strokes, heads, "The strokes")


def remarks(config: Config, frame: FrameFit) -> list[str]:
    """What a person should know of the result, one sentence each."""
    off = turn_deg(frame.rotation, np.array(config.hand.rotation))
    lines = [
        f"The frame is right within {frame.error_bound_deg:.1f}° (95 %, judged by how "
        "far the measurements disagree); the rotation in force differs from it by "
        f"{off:.1f}°.",
        f"Residual {frame.residual_mm:.1f} mm.",
        *(f"Note: {remark}." for remark in frame.left_out),
    ]
    if not stands_upright(frame.rotation):
        lines.append(
            "With this frame the robot's z axis does not point up: right for an arm that hangs or "
            "leans, else two strokes were reversed or axes were taken for one another."
        )
    return lines


def doubt_of(frame: FrameFit) -> str:
    """Why a person has to accept it, "" if they need not; RefusedError if it is no use."""
    bound = frame.error_bound_deg
    if bound > BAD_DEG:
        raise RefusedError(
            f"The frame may be off by {bound:.1f}°, and more than {BAD_DEG:g}° is no use: "
            f"{_advice(frame)}."
        )
    if bound > GOOD_DEG:
        return f"The frame may be off by {bound:.1f}°, more than {GOOD_DEG:g}°: {_advice(frame)}"
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
    """What is written. Buttons that were not measured now stay as in `before`, the file in force.

    A `translation_scale` that an earlier version measured does not: the configuration's counts.
    """
    changes: dict[str, Any] = {}
    if before is not None:
        changes = deepcopy(read_calibrated(before, KIND).changes)
    rotation = [list(row) for row in rows(outcome.frame.rotation)]
    changes["hand"] = {"rotation": rotation}
    buttons = outcome.buttons
    if buttons is not None and (buttons.wrong or config.controller.mapping):
        mapping = changes.setdefault("controller", {}).setdefault("mapping", {})
        mapping[buttons.controller_type] = dict(buttons.paths)
    return Calibration(
        KIND,
        changes,
        outcome.source,
        _quality(config, outcome),
        simulated,
        doubt_of(outcome.frame),
    )


def _quality(config: Config, outcome: FrameResult) -> dict[str, Any]:
    frame, lit, buttons = outcome.frame, outcome.lit, outcome.buttons
    quality: dict[str, Any] = {
        "error_bound_95_deg": round(frame.error_bound_deg, 3),
        "residual_mm": round(frame.residual_mm, 3),
        "changed_by_deg": round(turn_deg(frame.rotation, np.array(config.hand.rotation)), 3),
    }
    used = [stroke for stroke in frame.strokes if stroke.used]
    quality["off_axis_deg"] = [f"{one.line.name} {one.angle_deg:.2f}" for one in used]
    quality["left_out"] = list(frame.left_out)
    if lit is not None:
        quality["directions_lit"] = f"{sum(lit.values())} of {len(SIX_DIRECTIONS)}"
    if buttons is not None:
        quality["buttons_put_right"] = list(buttons.wrong)
    return quality


@styled
def fit_figure(fit: FrameFit) -> Figure:
    """How far each stroke is off its axis in the frame that they make."""
    figure = new_figure(PAGE_IN, 3.4)
    axes, numbers = figure.subplots(), np.arange(len(fit.strokes))
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
    figure.suptitle(
        f"Frame from {len(fit.strokes)} strokes: right within {fit.error_bound_deg:.1f}° (95 %), "
        f"residual {fit.residual_mm:.1f} mm"
    )
    return figure

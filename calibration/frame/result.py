"""From fits to what is written, and whether it may be."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.frame.buttons import ButtonFinding
from calibration.frame.diagnosis import stands_upright
from calibration.frame.fit import BAD_DEG, GOOD_DEG, FrameFit
from calibration.frame.prompts import SIX_WAYS, Move
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.rotation import Matrix, turn_deg
from calibration.frame.touches import TouchFit
from calibration.store import Calibration
from tams_app.config import Config, HandConfig, MappingConfig
from tams_app.config.calibrated import read_calibrated
from tams_app.config.reader import read_yaml

KIND = "frame"
_DIGITS = 9  # the configuration wants orthonormal to 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """All that one run of the wizard found out."""

    frame: FrameFit | TouchFit
    buttons: ButtonFinding | None
    lit: Mapping[Move, bool] | None  # None: not tried
    true_rotation: Matrix | None


def rows(rotation: Matrix) -> tuple[tuple[float, float, float], ...]:
    """As the configuration has it."""
    rounded = np.round(rotation, _DIGITS) + 0.0  # no negative zeros
    return tuple((float(row[0]), float(row[1]), float(row[2])) for row in rounded)


def hand_with(hand: HandConfig, frame: FrameFit | TouchFit, keep_scale: bool) -> HandConfig:
    """The hand's mapping with the new frame."""
    update: dict[str, Any] = {"rotation": rows(frame.rotation)}
    if isinstance(frame, TouchFit) and not keep_scale:
        update["translation_scale"] = round(frame.scale, 4)
    return hand.model_copy(update=update)


def remarks(config: Config, frame: FrameFit | TouchFit) -> list[str]:
    """What a person should know of the result, one sentence each."""
    off = turn_deg(frame.rotation, np.array(config.hand.rotation))
    said = [
        f"The frame is right within {frame.error_bound_deg:.1f}° (95 %, as far as the "
        "measurements' disagreement tells); the rotation in force differs from it by "
        f"{off:.1f}°.",
        f"Residual {frame.residual_mm:.1f} mm, condition {frame.condition:.2f} (1 is best).",
    ]
    if isinstance(frame, FrameFit):
        said += [f"Note: {remark}." for remark in frame.left_out]
    else:
        said.append(f"The robot travels {frame.scale:.3f} times as far as the hand.")
        said += [f"Note: touch {n + 1} does not fit and is left out." for n in frame.left_out]
        if frame.is_flat:
            said.append("The points lie in one plane: a mirrored list of them would not show.")
    if not stands_upright(frame.rotation):
        said.append(
            "With this frame the robot's z axis does not point up: right for an arm that hangs or "
            "leans, else two strokes were reversed or axes were taken for one another."
        )
    return said


def doubt(frame: FrameFit | TouchFit) -> str:
    """Why the result needs a second thought, "" if it does not; Refused if it is no use."""
    bound = frame.error_bound_deg
    if bound > BAD_DEG:
        raise RefusedError(
            Reason.UNCERTAIN,
            f"The frame may be off by {bound:.1f}°, and more than {BAD_DEG:g}° is no use: "
            f"{_advice(frame)}.",
        )
    if bound > GOOD_DEG:
        return f"The frame may be off by {bound:.1f}°, more than {GOOD_DEG:g}°: {_advice(frame)}."
    return ""


def calibration(
    config: Config,
    outcome: Outcome,
    hand: HandConfig,
    before: Path | None,
    source: str,
    simulated: bool,
) -> Calibration:
    """What is written. A part that was not measured now stays as `before`, the file in force."""
    changes: dict[str, Any] = {}
    if before is not None:
        changes = deepcopy(read_calibrated(before, KIND, read_yaml).changes)
    new_hand: dict[str, Any] = {"rotation": [list(row) for row in hand.rotation]}
    if hand.translation_scale != config.hand.translation_scale:
        new_hand["translation_scale"] = hand.translation_scale
    changes["hand"] = _section(changes, "hand") | new_hand
    buttons = outcome.buttons
    if buttons is not None and (buttons.wrong or config.controller.mapping):
        mapping = changes.setdefault("controller", {}).setdefault("mapping", {})
        mapping[buttons.controller_type] = dict(buttons.paths)
    return Calibration(KIND, changes, source, _quality(config, outcome), simulated)


def _section(changes: dict[str, Any], key: str) -> dict[str, Any]:
    return dict(changes[key]) if key in changes else {}


def mapped(config: Config, buttons: ButtonFinding | None) -> Config:
    """The configuration with the buttons as they were found."""
    if buttons is None:
        return config
    controller = config.controller
    mapping: dict[Any, MappingConfig] = dict(controller.mapping)
    mapping[buttons.controller_type] = MappingConfig(**buttons.paths)
    return config.model_copy(
        update={"controller": controller.model_copy(update={"mapping": mapping})}
    )


def _quality(config: Config, outcome: Outcome) -> dict[str, Any]:
    frame, lit, buttons = outcome.frame, outcome.lit, outcome.buttons
    quality: dict[str, Any] = {
        "error_bound_95_deg": round(frame.error_bound_deg, 3),
        "residual_mm": round(frame.residual_mm, 3),
        "condition": round(frame.condition, 3),
        "changed_by_deg": round(turn_deg(frame.rotation, np.array(config.hand.rotation)), 3),
    }
    if isinstance(frame, FrameFit):
        quality["off_axis_deg"] = [
            f"{stroke.line.name} {stroke.angle_deg:.2f}" for stroke in frame.strokes if stroke.used
        ]
        quality["samples"] = sum(s.line.samples for s in frame.strokes if s.used)
        quality["left_out"] = list(frame.left_out)
    else:
        quality["scale"] = round(frame.scale, 4)
        quality["missed_by_the_others_mm"] = [round(miss, 2) for miss in frame.misses_mm]
        quality["left_out"] = [f"touch {n + 1}" for n in frame.left_out]
    if lit is not None:
        quality["directions_lit"] = f"{sum(lit.values())} of {len(SIX_WAYS)}"
    if buttons is not None:
        quality["buttons_put_right"] = list(buttons.wrong)
    if outcome.true_rotation is not None:
        quality["true_error_deg"] = round(turn_deg(frame.rotation, outcome.true_rotation), 3)
    return quality


def _advice(frame: FrameFit | TouchFit) -> str:
    if isinstance(frame, FrameFit):
        worst = max((s for s in frame.strokes if s.used), key=lambda stroke: stroke.angle_deg)
        return (
            f"a {worst.line.name} stroke is {worst.angle_deg:.1f}° off its axis; move along "
            "something straight, make longer strokes, or more of them with --rounds"
        )
    worst_touch = int(np.argmax(frame.misses_mm))
    return (
        f"touch {worst_touch + 1} is {frame.misses_mm[worst_touch]:.0f} mm from where the others "
        "have it; touch more points, farther apart, and each exactly"
    )

"""Trying the six directions: where teleoperation would send the arm, which is not connected."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
from rich.table import Table
from rich.text import Text

from calibration.frame.capture import MIN_TRAVEL_M, Capture, travel_m
from calibration.frame.sources import SHOW_EVERY, SIX_DIRECTIONS, HandSource, Move
from calibration.frame.stroke import Reason, RefusedError
from calibration.ui import WizardUI, as_text
from tams_app.config import Config, HandConfig
from tams_app.records import ControllerSample
from tams_app.teleop.motion import HandMotion

_ARROWS = {"+x": "⊙", "−x": "⊗", "+y": "←", "−y": "→", "+z": "↑", "−z": "↓"}
MIN_SPEED_M_S = 0.04  # of the hand: slower, no direction is lit
MAX_OFF_AXIS_DEG = 30.0
TRIES = 3  # of one direction: people take left for right


def try_six_directions(
    ui: WizardUI, source: HandSource, config: Config, hand: HandConfig
) -> dict[Move, bool]:
    """Whether each direction lit up when it was asked for; those that Enter skipped are missing."""
    right: dict[Move, bool] = {}
    for wanted in SIX_DIRECTIONS:
        ui.say(f"Hold the trigger, move along {wanted.name} ({wanted.meaning}), let go.")
        for left in reversed(range(TRIES)):
            wrong = _try_direction(ui, source, config, hand, wanted, right)
            if wrong is None:
                right.pop(wanted, None)
                break
            right[wanted] = not wrong
            if not wrong:
                break
            ui.say(wrong + (" Once more." if left else ""))
    ui.say(as_text(_compass_table(None, None, right)))
    return right


def _try_direction(
    ui: WizardUI,
    source: HandSource,
    config: Config,
    hand: HandConfig,
    wanted: Move,
    right: Mapping[Move, bool],
) -> str | None:
    """What was wrong with one try of a direction, "" for nothing; None if Enter skipped it."""
    capture, compass = Capture(config), Compass(config, hand)
    source.ask(wanted)
    count, done = 0, None
    while done is None or travel_m(done) < MIN_TRAVEL_M:
        now_ns, sample = source.next()
        try:
            done = capture.take(sample, now_ns)
        except RefusedError as error:
            if error.reason is Reason.FRAME_CHANGED:
                raise
            return str(error)
        compass.update(sample, now_ns, held=capture.so_far is not None)
        count += 1
        if count % SHOW_EVERY == 0:
            ui.show(_compass_table(wanted, compass.lit, right))
            if ui.pressed():
                return None
    lit = compass.mostly()
    if lit is None:
        return f"Nothing lit up when {wanted.name} was asked for: move faster, and straight."
    return "" if lit == wanted else f"{lit.name} lit up when {wanted.name} was asked for."


def _compass_table(asked: Move | None, lit: Move | None, right: Mapping[Move, bool]) -> Table:
    """The six directions: which one is asked for, which one the arm would take now."""
    table = Table(box=None, show_header=False)
    for move in SIX_DIRECTIONS:
        style = "bold black on green" if move == lit else "" if move == asked else "dim"
        table.add_row(
            "▶" if move == asked else " ",
            Text(f" {_ARROWS[move.name]} {move.name} ", style),
            move.meaning,
            {True: "✓", False: "✗", None: ""}[right.get(move)],
        )
    return table


class Compass:
    """Lights the direction that teleoperation would send the arm in."""

    def __init__(self, config: Config, hand: HandConfig) -> None:
        """`hand`: the mapping to be tried."""
        self._motion = HandMotion(hand, config.freshness.pose_frozen_ms * 1e6)
        self._scale = hand.translation_scale
        self._last_ns: int | None = None
        self.lit: Move | None = None
        self._seen: Counter[Move] = Counter()

    def update(self, sample: ControllerSample, now_ns: int, held: bool) -> Move | None:
        """The direction that is lit now; those lit while the trigger is `held` are counted."""
        if self._last_ns is None:
            self._motion.anchor(sample)
            self._last_ns = now_ns
        interval_s = (now_ns - self._last_ns) / 1e9
        self._last_ns = now_ns
        twist = self._motion.update(sample, now_ns, interval_s)
        self.lit = direction_of(twist.linear / self._scale)
        if held and self.lit is not None:
            self._seen[self.lit] += 1
        return self.lit

    def mostly(self) -> Move | None:
        """The direction that was lit longest since this was last asked."""
        most = self._seen.most_common(1)
        self._seen.clear()
        return most[0][0] if most else None


def direction_of(velocity: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Move | None:
    """The robot's axis that a velocity [m/s] goes along within 30°, None for none."""
    speed = float(np.linalg.norm(velocity))
    if speed < MIN_SPEED_M_S:
        return None
    best = max(SIX_DIRECTIONS, key=lambda wanted: float(wanted.direction @ velocity))
    share = float(best.direction @ velocity) / speed
    return best if share >= math.cos(math.radians(MAX_OFF_AXIS_DEG)) else None

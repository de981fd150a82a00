"""The numbers a belief is made of: where each of them stands in the filter's state."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from hw.sim.layout import BLOCK_HEIGHT_M
from hw.sim.operator.vision.detections import Cue, Sighting, Thing
from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Vector

# The tool's turn: tilts about the base frame's x and y, then the yaw.
TOOL, TURN, BLOCK, BLOCK_YAW, CONTAINER = slice(0, 3), slice(3, 6), slice(6, 9), 9, slice(10, 12)
TOOL_YAW, BLOCK_Z = TURN.stop - 1, BLOCK.stop - 1
SIZE = 12  # of the things; the errors that last stand behind them


# How many numbers an error has: a shift of the whole, of several points also stretch and shear.
_NUMBERS = {
    (Thing.TOOL, Cue.COLOUR): 2,
    (Thing.TOOL, Cue.MARKER_AHEAD): 6,
    (Thing.TOOL, Cue.MARKER_LEFT): 6,
    (Thing.TOOL, Cue.MARKER_RIGHT): 6,
    (Thing.BLOCK, Cue.COLOUR): 2,
    (Thing.CONTAINER, Cue.MARKER): 2,
    (Thing.CONTAINER, Cue.COLOUR): 2,
}


class LastingErrors:
    """Where the errors that last stand in the state, each in units of its standard deviation.

    Some for each cue of each thing in each view, and one for the block's heading. They are not
    estimated, only reckoned with: what one view repeats glance after glance is no new evidence.
    """

    def __init__(self, views: Iterable[str]) -> None:
        self._places: dict[tuple[str, Thing, Cue], slice] = {}
        self._headings: dict[str, int] = {}
        self.size = SIZE
        for view in views:
            for (thing, cue), count in _NUMBERS.items():
                self._places[view, thing, cue] = slice(self.size, self.size + count)
                self.size += count
            self._headings[view] = self.size
            self.size += 1

    def of(self, view: str, thing: Thing, cue: Cue) -> slice:
        return self._places[view, thing, cue]

    def of_heading(self, view: str) -> int:
        return self._headings[view]

    def slopes(self, sighting: Sighting, kept: slice) -> Matrix:
        """How its coordinates move with the errors at `kept`, shape (2n, numbers)."""
        slopes = np.zeros((len(sighting.pixels), 2, kept.stop - kept.start))
        slopes[:, 0, 0] = slopes[:, 1, 1] = sighting.lasting_px
        if slopes.shape[2] > 2:
            away = sighting.pixels - sighting.pixels.mean(axis=0)
            away = away / max(1.0, math.sqrt(float((away**2).sum()) / len(away) / 2.0))
            slopes[:, 0, 2:4] = slopes[:, 1, 4:6] = sighting.warp_px / math.sqrt(2.0) * away
        return slopes.reshape(-1, slopes.shape[2])

    def keep(self, view: str, thing: Thing, part: float, kept: Vector) -> None:
        """Write into `kept`, shape (size,), the `part` of this thing's errors that stays."""
        for of, cue in _NUMBERS:
            if of is thing:
                kept[self._places[view, thing, cue]] = part
        if thing is Thing.BLOCK:
            kept[self._headings[view]] = part


@dataclass(frozen=True, slots=True)
class Gap:
    """A direction of interest: rows over the things' state, shape (n, SIZE)."""

    rows: Matrix = field(repr=False)

    @staticmethod
    def to_block() -> Gap:
        rows = np.zeros((2, SIZE))
        rows[:, BLOCK] = np.eye(3)[:2]
        rows[:, TOOL] = -np.eye(3)[:2]
        return Gap(rows)

    @staticmethod
    def to_container() -> Gap:
        rows = np.zeros((2, SIZE))
        rows[:, CONTAINER] = np.eye(2)
        rows[:, TOOL] = -np.eye(3)[:2]
        return Gap(rows)


def place_of(thing: Thing) -> slice:
    return {Thing.TOOL: TOOL, Thing.BLOCK: BLOCK, Thing.CONTAINER: CONTAINER}[thing]


def rest_height(thing: Thing) -> float:
    return BLOCK_HEIGHT_M / 2 if thing is Thing.BLOCK else 0.0


def swing(arm: Vector) -> Matrix:
    """How a point moves [m/rad], shape (3, 3), when the tool turns about each axis."""
    x, y, z = arm
    return np.array([(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)])


def largest_sigma(covariance: Matrix) -> float:
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance)[-1])))

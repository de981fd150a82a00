"""The state of the operator's belief: its numbers, their noise, the filter's arithmetic."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from hw.sim.layout import BLOCK_HEIGHT_M
from hw.sim.operator.vision.views import Cue, Matrix, Sighting, Thing
from tams_app.records import Vector

# The tool's turn: tilts about the base frame's x and y, then the yaw.
TOOL, TURN, BLOCK, BLOCK_YAW, CONTAINER = slice(0, 3), slice(3, 6), slice(6, 9), 9, slice(10, 12)
TOOL_YAW, BLOCK_Z = TURN.stop - 1, BLOCK.stop - 1
SIZE = 12  # of the things; the errors that last stand behind them

# Distances of interest in the table's plane, shape (2, SIZE): the tool's from block and container.
TO_BLOCK, TO_CONTAINER = np.zeros((2, 2, SIZE))
TO_BLOCK[:, BLOCK], TO_CONTAINER[:, CONTAINER] = np.eye(2, 3), np.eye(2)
TO_BLOCK[:, TOOL] = TO_CONTAINER[:, TOOL] = -np.eye(2, 3)

# What a moving tool and passing time make uncertain between two glances.
_ARM_UNCERTAIN = 0.25  # of the motion asked for: limits, clutch, a misjudged direction
_DRIFT_M = 0.002  # in a second, unseen
_TURN_UNCERTAIN = 0.15  # of the turn asked for
_TILTS = 0.06  # of it: a turn about an axis that is not quite the vertical
_DRIFT_RAD = 0.01
_BLOCK_TURN_UNCERTAIN = 0.3  # of the turn asked for, near the fingers
_SLIPS = 0.10  # of the motion of what is carried
_REST_DRIFT_M = 0.001
_LEAST_DOUBT = 0.06  # variance of whether it is carried


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
    """Places in the state of the errors that last, each in units of its standard deviation.

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
        """The derivative of its coordinates by the errors at `kept`, shape (2n, numbers)."""
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


class GaussianEstimate:
    """A state, shape (n,), and its covariance, shape (n, n), in whatever units the caller has.

    The numbers that are not sought stay what they are, but how uncertain they are counts (Schmidt
    1966): for errors too fickle to be learnt, yet too lasting to be averaged out.
    """

    def __init__(self, state: Vector, sigma: Vector, sought: int) -> None:
        """`sought`: so many of the numbers are estimated, the others only reckoned with."""
        self._sought = sought
        self.state = np.array(state, float)
        self.covariance: Matrix = np.diag(np.asarray(sigma, float) ** 2)

    def fade(self, kept: Vector) -> None:
        """Numbers of mean 0 and variance 1 keep only a part, 0..1, of what they were."""
        self.state = kept * self.state
        self.covariance = self.covariance * kept[:, None] * kept
        self.covariance[np.diag_indices(len(kept))] += 1.0 - kept**2

    def forget(self, place: slice, sigma: float) -> None:
        """Nothing is known of the numbers at `place` but their standard deviation."""
        self.covariance[place, :] = self.covariance[:, place] = 0.0
        self.covariance[place, place] = np.eye(place.stop - place.start) * sigma**2

    def surprise(self, rows: Matrix, gaps: Vector, noise: Matrix) -> float:
        """Squared distance of a measurement from what was expected, in standard deviations."""
        spread = rows @ self.covariance @ rows.T + noise
        return float(gaps @ np.linalg.solve(spread, gaps))

    def update(self, rows: Matrix, gaps: Vector, noise: Matrix) -> None:
        """Take in a measurement, shape (m,), that is off by `gaps` from what was expected.

        `rows`, shape (m, n): its Jacobian; `noise`, shape (m, m): its covariance.
        """
        weighted = rows @ self.covariance
        spread = weighted @ rows.T + noise
        gain = np.linalg.solve(spread, weighted).T
        gain[self._sought :] = 0.0
        self.state = self.state + gain @ gaps
        known = gain @ weighted
        covariance = self.covariance - known - known.T + gain @ spread @ gain.T
        self.covariance = (covariance + covariance.T) / 2


def motion_noise(moved: Vector, turned: Vector, seconds: float, along: float, near: bool) -> Matrix:
    """Covariance, shape (SIZE, SIZE), that motion [m], [rad] asked of the tool adds.

    `along`: the part of it that the block shares; `near`: whether it may be in the fingers. What
    makes the tool uncertain makes what it carries uncertain with it.
    """
    path, turn, drift = math.sqrt(moved @ moved), math.sqrt(turned @ turned), math.sqrt(seconds)
    noise = np.zeros(SIZE)
    noise[TOOL] = (_ARM_UNCERTAIN * path) ** 2 + (_DRIFT_M * drift) ** 2
    noise[TURN] = (_TILTS * turn) ** 2 + (_DRIFT_RAD * drift) ** 2
    noise[TOOL_YAW] += (_TURN_UNCERTAIN * turn) ** 2
    noise[BLOCK] = (_REST_DRIFT_M * drift) ** 2 + along**2 * noise[TOOL]
    noise[BLOCK_YAW] = (_DRIFT_RAD * drift) ** 2
    noise[CONTAINER] = (_REST_DRIFT_M * drift) ** 2
    if near:
        doubt = max(_LEAST_DOUBT, along * (1.0 - along))
        noise[BLOCK] += doubt * path**2 + (_SLIPS * path) ** 2
        noise[BLOCK_YAW] += (_BLOCK_TURN_UNCERTAIN * turn) ** 2
    covariance = np.diag(noise)
    covariance[TOOL, BLOCK] = covariance[BLOCK, TOOL] = along * np.diag(noise[TOOL])
    return covariance


def place_of(thing: Thing) -> slice:
    return {Thing.TOOL: TOOL, Thing.BLOCK: BLOCK, Thing.CONTAINER: CONTAINER}[thing]


def rest_height(thing: Thing) -> float:
    return BLOCK_HEIGHT_M / 2 if thing is Thing.BLOCK else 0.0


def swing(arm: Vector) -> Matrix:
    """Motion of a point [m/rad], shape (3, 3), when the tool turns about each axis."""
    x, y, z = arm
    return np.array([(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)])


def largest_sigma(covariance: Matrix) -> float:
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance)[-1])))

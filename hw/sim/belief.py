"""Where the operator believes the things to be: one estimate, fed by every view that shows them.

An extended Kalman filter over tool, block and container. What is seen enters by the inverse of its
variance, whichever view it comes from; what is not seen becomes uncertain with time and with the
hand's own motion. A block near the fingers may come along with them or stay: how much of the tool's
motion it shares is learnt by looking.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hw.sim.belief_state import (
    BLOCK,
    BLOCK_YAW,
    BLOCK_Z,
    CONTAINER,
    SIZE,
    TOOL,
    TOOL_YAW,
    TURN,
    Gap,
    largest_sigma,
    place_of,
    rest_height,
    swing,
)
from hw.sim.layout import BLOCK_EDGE_M, BLOCK_HEIGHT_M
from hw.sim.vision.detections import HeadingSighting, Sighting, Thing
from hw.sim.vision.pinhole import Matrix, Pinhole
from hw.sim.vision.solids import about_vertical, tilted, tool_rotation
from tams_app.records import Vector

_QUARTER = math.pi / 2

# Before anything is seen: the gripper about where it is left, the things on their sides of the mat.
_START = np.array(
    [0.35, 0.0, 0.18, 0.0, 0.0, 0.0, 0.33, -0.14, BLOCK_HEIGHT_M / 2, 0.0, 0.33, 0.15]
)
_START_SIGMA = np.array([0.03, 0.03, 0.03, 0.01, 0.01, 0.03, 0.10, 0.10, 0.003, 0.6, 0.10, 0.10])

_ON_ITS_SIDE = np.array([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])

_ARM_UNCERTAIN = 0.25  # of the motion asked for: limits, clutch, a misjudged direction
_DRIFT_M = 0.002  # in a second, unseen
_TURN_UNCERTAIN = 0.15  # of the turn asked for
_TILTS = 0.06  # of it: a turn about an axis that is not quite the vertical
_DRIFT_RAD = 0.01
_NEAR_M = 0.030  # of the TCP: it may be in the fingers
_SLIPS = 0.10  # of the motion of what is carried
_REST_DRIFT_M = 0.001
_ON_TABLE_SIGMA_M = 0.0015
_CLEARLY = 3.0  # standard deviations above it
_LEAST_DOUBT = 0.06  # variance of whether it comes along
_LEARNS = 0.35  # of each glance about whether the block comes along
_TELLING_M = 0.0015  # the tool's motion between glances that shows it
_SURPRISE = 25.0  # squared, in standard deviations of a pixel pair
_SURPRISES = 3  # in a row: the thing is elsewhere
_LOST_SIGMA_M = 0.05


class Belief:
    """The state and its covariance; all in the arm's base frame, metres and radians."""

    def __init__(self, fixed: Mapping[str, Pinhole], wrist: Mapping[str, Pinhole]) -> None:
        """`fixed`: cameras in the base frame; `wrist`: cameras in the tool's frame."""
        self._fixed, self._wrist = fixed, wrist
        self.state: Vector = _START.copy()
        self.covariance: Matrix = np.diag(_START_SIGMA**2)
        self.comes_along = 0.0  # the part of the tool's motion that the block shares
        self.lies = False  # the block, on its side
        self._tumbled = 0
        self.seen = dict.fromkeys(Thing, False)
        self._information: dict[str, Matrix] = {}
        self._surprises = dict.fromkeys(Thing, 0)

    @property
    def tcp(self) -> Vector:
        return self.state[TOOL]

    @property
    def tool_yaw(self) -> float:
        return float(self.state[TOOL_YAW])

    @property
    def tool_axes(self) -> Matrix:
        """The tool's axes in the base frame, as columns."""
        return tilted(self.state[TURN][:2]) @ tool_rotation(self.tool_yaw)

    @property
    def block(self) -> Vector:
        return self.state[BLOCK]

    @property
    def block_yaw(self) -> float:
        return float(self.state[BLOCK_YAW])

    @property
    def container(self) -> Vector:
        """Its middle on the table."""
        return np.array([*self.state[CONTAINER], 0.0])

    def sigma_of(self, thing: Thing) -> float:
        """The largest standard deviation of a position in the table's plane [m]."""
        place = place_of(thing)
        return largest_sigma(self.covariance[place, place][:2, :2])

    def pixel_sigma(self, view: str, thing: Thing) -> float:
        """How uncertain it is where `thing` appears in `view` [px]."""
        nowhere = Sighting(view, thing, np.zeros((1, 2)), np.zeros((1, 3)), 0.0)
        rows, _ = self._compare(nowhere)
        return largest_sigma(rows @ self.covariance @ rows.T)

    @property
    def block_axes(self) -> Matrix:
        """The block's axes in the base frame, as columns; its own z is its long side."""
        turn = about_vertical(self.block_yaw)
        return turn @ _ON_ITS_SIDE if self.lies else turn

    def gap_sigma(self, gap: Gap) -> float:
        """The same of a distance between two things."""
        return largest_sigma(gap.rows @ self.covariance @ gap.rows.T)

    def yaw_sigma(self, place: int) -> float:
        return math.sqrt(self.covariance[place, place])

    def heading_sigma(self) -> float:
        """Of the block's yaw against the tool's [rad]."""
        places = [BLOCK_YAW, TOOL_YAW]
        (block, shared), (_, tool) = self.covariance[np.ix_(places, places)]
        return math.sqrt(max(0.0, block + tool - 2.0 * shared))

    def camera(self, view: str) -> Pinhole:
        """The camera of `view` in the base frame, as the operator believes it to stand."""
        if view in self._fixed:
            return self._fixed[view]
        camera, turn = self._wrist[view], self.tool_axes
        return Pinhole(self.tcp + turn @ camera.place, turn @ camera.axes, camera.focal_px)

    # --- time -----------------------------------------------------------------------------------

    def predict(self, moved: Vector, turned: Vector, seconds: float) -> None:
        """The tool was asked to move [m] and turn [rad], shape (3,), since the last glance."""
        self._information = {}
        along = self.comes_along if self._is_near() else 0.0
        path, drift = math.sqrt(moved @ moved), math.sqrt(seconds)
        self.state[TOOL] += moved
        self.state[TURN] += turned
        turned_by = math.sqrt(turned @ turned)
        self.state[BLOCK] += along * moved
        self.state[BLOCK_YAW] += along * turned[2]
        noise = np.zeros(SIZE)
        noise[TOOL] = (_ARM_UNCERTAIN * path) ** 2 + (_DRIFT_M * drift) ** 2
        noise[TURN] = (_TILTS * turned_by) ** 2 + (_DRIFT_RAD * drift) ** 2
        noise[TOOL_YAW] += (_TURN_UNCERTAIN * turned_by) ** 2
        noise[BLOCK] = (_REST_DRIFT_M * drift) ** 2
        noise[CONTAINER] = (_REST_DRIFT_M * drift) ** 2
        noise[BLOCK_YAW] = (_DRIFT_RAD * drift) ** 2
        self._carry(along, noise)
        if self._is_near():
            doubt = max(_LEAST_DOUBT, along * (1.0 - along))
            noise[BLOCK] += doubt * path**2 + (_SLIPS * path) ** 2
            noise[BLOCK_YAW] += (0.3 * turned_by) ** 2
        self.covariance[np.diag_indices(SIZE)] += noise

    def _carry(self, along: float, noise: Vector) -> None:
        """What makes the tool uncertain makes what it carries uncertain with it."""
        spread = noise[TOOL].copy()
        self.covariance[TOOL, BLOCK] += along * np.diag(spread)
        self.covariance[BLOCK, TOOL] += along * np.diag(spread)
        noise[BLOCK] += along**2 * spread

    def doubt_the_grip(self) -> None:
        """The fingers moved: a block near them may be in them now, or no longer."""
        self.comes_along = 0.5

    def learn_whether_it_comes_along(self, before: Vector) -> None:
        """After a glance: did the block move as the tool did since the state `before`?"""
        if not self._is_near():
            self.comes_along = 0.0
            return
        moved = self.state[TOOL] - before[TOOL]
        path = math.sqrt(moved @ moved)
        if path < _TELLING_M:
            return
        shared = float((self.state[BLOCK] - before[BLOCK]) @ moved) / path**2
        self.comes_along += _LEARNS * (min(1.0, max(0.0, shared)) - self.comes_along)

    def _is_near(self) -> bool:
        gap = self.state[BLOCK] - self.state[TOOL]
        return bool(gap @ gap < _NEAR_M**2)

    # --- seeing ---------------------------------------------------------------------------------

    def lay_on_table(self) -> None:
        """Things lie on the table unless they are carried or seen above it."""
        above = self.state[BLOCK_Z] - (BLOCK_EDGE_M if self.lies else BLOCK_HEIGHT_M) / 2
        known = self.covariance[BLOCK_Z, BLOCK_Z] + _ON_TABLE_SIGMA_M**2
        if self._is_near() or above**2 > _CLEARLY**2 * known:
            return
        row = np.zeros((1, SIZE))
        row[0, BLOCK_Z] = 1.0
        self._update("", row, np.array([-above]), _ON_TABLE_SIGMA_M)

    def _place(self, sighting: Sighting) -> None:
        """First sight of block or container: where the pixel's ray meets the table."""
        camera = self.camera(sighting.view)
        found = camera.ray_at_height(sighting.pixels[0], rest_height(sighting.thing))
        where = place_of(sighting.thing)
        self.state[where] = found[: where.stop - where.start]
        for row in range(where.start, where.start + 2):
            self.covariance[row, :] = self.covariance[:, row] = 0.0
            self.covariance[row, row] = 0.01**2

    def take(self, sightings: Sequence[Sighting]) -> None:
        """A glance's sightings enter; what no view expected only when it happens again and again.

        One view against the others is mistaken: something else looks like the thing.
        """
        surprising = [sighting for sighting in sightings if not self._take_expected(sighting)]
        missed = {id(one) for one in surprising}
        agreed = {one.thing for one in sightings if id(one) not in missed}
        for thing in agreed:
            self._surprises[thing] = 0
        for thing in {one.thing for one in surprising} - agreed:
            self._surprises[thing] += 1
            if self._surprises[thing] >= _SURPRISES:
                self._think_again(thing, [one for one in surprising if one.thing is thing])

    def _take_expected(self, sighting: Sighting) -> bool:
        """True if the sighting entered, False if it surprises."""
        if not self.seen[sighting.thing] and sighting.thing is not Thing.TOOL:
            self._place(sighting)
        self.seen[sighting.thing] = True
        rows, gaps = self._compare(sighting)
        if self._is_surprising(rows, gaps, sighting.sigma_px):
            return False
        self._update(sighting.view, rows, gaps, sighting.sigma_px)
        return True

    def _think_again(self, thing: Thing, sightings: Sequence[Sighting]) -> None:
        """The thing is not where it was believed to be: begin anew with what is seen."""
        self._surprises[thing] = 0
        where = place_of(thing)
        self.covariance[where, where] += np.eye(where.stop - where.start) * _LOST_SIGMA_M**2
        for sighting in sightings:
            rows, gaps = self._compare(sighting)
            self._update(sighting.view, rows, gaps, sighting.sigma_px)

    def take_heading(self, sighting: HeadingSighting) -> None:
        """The block's yaw against the tool's; a square looks the same after a quarter turn."""
        row = np.zeros((1, SIZE))
        row[0, BLOCK_YAW], row[0, TOOL_YAW] = 1.0, -1.0
        if sighting.lying is not self.lies:
            self._tumble(sighting)
            return
        self._tumbled = 0
        period = 2.0 * _QUARTER if self.lies else _QUARTER
        gap = sighting.heading - (self.block_yaw - self.tool_yaw)
        gap = (gap + period / 2) % period - period / 2
        self._update(sighting.view, row, np.array([gap]), sighting.sigma)

    def _tumble(self, sighting: HeadingSighting) -> None:
        """The block seems to lie where it stood, or to stand: believed when it lasts."""
        self._tumbled += 1
        if self._tumbled < _SURPRISES:
            return
        self._tumbled, self.lies = 0, sighting.lying
        self.state[BLOCK_YAW] = self.tool_yaw + sighting.heading
        self.covariance[BLOCK_YAW, :] = self.covariance[:, BLOCK_YAW] = 0.0
        self.covariance[BLOCK_YAW, BLOCK_YAW] = sighting.sigma**2

    def shares(self, gap: Gap) -> dict[str, float]:
        """How much each view of the last glance contributed to knowing `gap`; they sum to 1.

        A view's part of the posterior covariance P: P I P, where I is the information it brought.
        Empty when none brought any.
        """
        rows = gap.rows @ self.covariance
        parts = {
            view: float(np.trace(rows @ information @ rows.T))
            for view, information in self._information.items()
        }
        whole = sum(parts.values())
        return {view: part / whole for view, part in parts.items()} if whole > 0.0 else {}

    def _compare(self, sighting: Sighting) -> tuple[Matrix, Vector]:
        """Jacobian, shape (2n, SIZE), and what was seen minus what was expected [px]."""
        camera, thing = self.camera(sighting.view), sighting.thing
        turn = self.tool_axes if thing is Thing.TOOL else np.eye(3)
        centre = np.zeros(3)
        centre[: place_of(thing).stop - place_of(thing).start] = self.state[place_of(thing)]
        points = centre + sighting.points @ turn.T
        gaps = (sighting.pixels - camera.project(points)).ravel()
        rows = np.zeros((len(gaps), SIZE))
        for place, point in enumerate(points):
            slope = camera.jacobian(point)
            part = rows[2 * place : 2 * place + 2]
            part[:, place_of(thing)] = slope[:, : place_of(thing).stop - place_of(thing).start]
            if thing is Thing.TOOL:
                part[:, TURN] = slope @ swing(point - self.tcp)
            elif sighting.view in self._wrist:  # the camera moves with the tool
                part[:, TOOL] -= slope
                part[:, TURN] -= slope @ swing(point - self.tcp)
        return rows, gaps

    def _is_surprising(self, rows: Matrix, gaps: Vector, sigma_px: float) -> bool:
        spread = rows @ self.covariance @ rows.T + np.eye(len(gaps)) * sigma_px**2
        return bool(gaps @ np.linalg.solve(spread, gaps) > _SURPRISE * len(gaps) / 2)

    def _update(self, view: str, rows: Matrix, gaps: Vector, sigma: float) -> None:
        weighted = rows @ self.covariance
        spread = weighted @ rows.T + np.eye(len(gaps)) * sigma**2
        gain = np.linalg.solve(spread, weighted).T
        self.state = self.state + gain @ gaps
        covariance = self.covariance - gain @ weighted
        self.covariance = (covariance + covariance.T) / 2
        if view:
            brought = rows.T @ rows / sigma**2
            self._information[view] = self._information.get(view, 0.0) + brought

"""The operator's belief of where things are: one estimate, fed by every view that shows them.

An extended Kalman filter over tool, block and container. What is not seen becomes uncertain with
time and with the hand's own motion. A block near the fingers may be carried by them or stay: how
much of the tool's motion it shares is learnt by looking.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from hw.sim.layout import BLOCK_EDGE_M, BLOCK_HEIGHT_M
from hw.sim.operator.belief_state import (
    BLOCK,
    BLOCK_YAW,
    BLOCK_Z,
    CONTAINER,
    SIZE,
    TOOL,
    TOOL_YAW,
    TURN,
    GaussianEstimate,
    LastingErrors,
    largest_sigma,
    motion_noise,
    place_of,
    rest_height,
    swing,
)
from hw.sim.operator.vision.solids import about_vertical, tilted, tool_rotation
from hw.sim.operator.vision.views import (
    HeadingSighting,
    Matrix,
    Pinhole,
    Sighting,
    Thing,
    fixed_cameras,
    wrist_cameras,
)
from tams_app.records import Vector

_QUARTER = math.pi / 2

# Before anything is seen: the gripper about where it is left, the things on their sides of the mat.
_START = np.array(
    [0.35, 0.0, 0.18, 0.0, 0.0, 0.0, 0.33, -0.14, BLOCK_HEIGHT_M / 2, 0.0, 0.33, 0.15]
)
_START_SIGMA = np.array([0.03, 0.03, 0.03, 0.01, 0.01, 0.03, 0.10, 0.10, 0.003, 0.6, 0.10, 0.10])

_ON_ITS_SIDE = np.array([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])

_NEAR_M = 0.030  # of the TCP: it may be in the fingers
_ON_TABLE_SIGMA_M = 0.0015
_CLEARLY = 3.0  # standard deviations above it
_LEARNS = 0.35  # of each glance about whether the block is carried
_TELLTALE_M = 0.0015  # the tool's motion between glances that shows it
_SURPRISE = 25.0  # squared, in standard deviations of a pixel pair
_SURPRISES = 3  # in a row: the thing is elsewhere
_LOST_SIGMA_M = 0.05
_LASTS_M = 0.05  # of motion in the image, until a lasting error is another
_LASTS_RAD = 0.3
_NOT_AT_ONCE_S = 0.010  # views are up to a frame (33 ms) apart: 33 / sqrt(12)
_FALLS = 0.5  # of its height over the table: how uncertain that is when the fingers move


class Belief:
    """The state and its covariance; all in the arm's base frame, metres and radians."""

    def __init__(self) -> None:
        self._fixed, self._wrist = fixed_cameras(), wrist_cameras()
        self._views = (*self._fixed, *self._wrist)
        self._lasting = LastingErrors(self._views)
        errors = self._lasting.size - SIZE
        self.estimate = GaussianEstimate(
            np.concatenate((_START, np.zeros(errors))),
            np.concatenate((_START_SIGMA, np.ones(errors))),
            SIZE,
        )
        self._velocity: Vector = np.zeros(self._lasting.size)  # of the state, as asked
        self.carried_part = 0.0  # the part of the tool's motion that the block shares
        self.lies = False  # the block, on its side
        self._tumbled = 0
        self.seen = dict.fromkeys(Thing, False)
        self._information: dict[str, Matrix] = {}
        self._surprises = dict.fromkeys(Thing, 0)

    @property
    def state(self) -> Vector:
        """The things' numbers, at the places of `belief_state`; a view to read and write."""
        return self.estimate.state[:SIZE]

    @property
    def covariance(self) -> Matrix:
        """Of the things' numbers; a view to read and write."""
        return self.estimate.covariance[:SIZE, :SIZE]

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
        """The uncertainty of `thing`'s place in `view` [px]."""
        nowhere = Sighting(view, thing, np.zeros((1, 2)), np.zeros((1, 3)), 0.0)
        rows, _ = self._compare(nowhere)
        return largest_sigma(rows @ self.estimate.covariance @ rows.T)

    @property
    def block_axes(self) -> Matrix:
        """The block's axes in the base frame, as columns; its own z is its long side."""
        turn = about_vertical(self.block_yaw)
        return turn @ _ON_ITS_SIDE if self.lies else turn

    def gap_sigma(self, gap: Matrix) -> float:
        """The same of a distance between two things, `TO_BLOCK` or `TO_CONTAINER`."""
        return largest_sigma(gap @ self.covariance @ gap.T)

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
        along = self.carried_part if self.block_is_near else 0.0
        self._note_velocity(moved, turned, along, seconds)
        self.state[TOOL] += moved
        self.state[TURN] += turned
        self._renew_errors(math.sqrt(moved @ moved), math.sqrt(turned @ turned))
        self.state[BLOCK] += along * moved
        self.state[BLOCK_YAW] += along * turned[2]
        self.covariance[:] += motion_noise(moved, turned, seconds, along, self.block_is_near)

    @contextmanager
    def ahead_by(self, moved: Vector, turned: Vector) -> Iterator[None]:
        """See meanwhile what shows the tool so much further on than the state is: [m], [rad].

        What was asked of the tool in between counts as known, as it does when the hand acts on a
        late view.
        """
        along = self.carried_part if self.block_is_near else 0.0
        shift = np.zeros(SIZE)
        shift[TOOL], shift[TURN] = moved, turned
        shift[BLOCK], shift[BLOCK_YAW] = along * moved, along * turned[2]
        self.state[:] += shift
        try:
            yield
        finally:
            self.state[:] -= shift

    def passes(self, sighting: Sighting) -> Matrix:
        """Pixels that a resting thing moves in a wrist view per metre and radian of the tool.

        Shape (2, 6); of a sighting of one pixel.
        """
        rows, _ = self._compare(sighting)
        return np.hstack((rows[:, TOOL], rows[:, TURN]))

    def _note_velocity(self, moved: Vector, turned: Vector, along: float, seconds: float) -> None:
        self._velocity[:SIZE] = 0.0
        if seconds > 0.0:
            self._velocity[TOOL], self._velocity[TURN] = moved / seconds, turned / seconds
            self._velocity[BLOCK] = along * moved / seconds

    def _renew_errors(self, path: float, turned_by: float) -> None:
        """An error lasts as long as the image of the thing does not change."""
        part = math.exp(-path / _LASTS_M - turned_by / _LASTS_RAD)
        kept = np.ones(self._lasting.size)
        for view in self._views:
            for thing in Thing:
                at_tool = thing is Thing.TOOL or (thing is Thing.BLOCK and self.block_is_near)
                if at_tool or view in self._wrist:
                    self._lasting.keep(view, thing, part, kept)
        self.estimate.fade(kept)

    def note_fingers_moved(self) -> None:
        """The fingers moved: a block near them may be in them now, or no longer."""
        self.carried_part = 0.5
        if self.block_is_near:
            height = max(0.0, float(self.state[BLOCK_Z]) - BLOCK_HEIGHT_M / 2)
            self.covariance[BLOCK_Z, BLOCK_Z] += (_FALLS * height) ** 2

    def learn_carried_part(self, before: Vector) -> None:
        """After a glance: what part of the tool's motion since `before` did the block share?"""
        if not self.block_is_near:
            self.carried_part = 0.0
            return
        moved = self.state[TOOL] - before[TOOL]
        path = math.sqrt(moved @ moved)
        if path < _TELLTALE_M:
            return
        shared = float((self.state[BLOCK] - before[BLOCK]) @ moved) / path**2
        self.carried_part += _LEARNS * (min(1.0, max(0.0, shared)) - self.carried_part)

    @property
    def block_is_near(self) -> bool:
        """True if it may be in the fingers."""
        gap = self.state[BLOCK] - self.state[TOOL]
        return bool(gap @ gap < _NEAR_M**2)

    # --- seeing ---------------------------------------------------------------------------------

    def hold_to_table(self) -> None:
        """Things lie on the table unless they are carried or seen above it."""
        above = self.state[BLOCK_Z] - (BLOCK_EDGE_M if self.lies else BLOCK_HEIGHT_M) / 2
        known = self.covariance[BLOCK_Z, BLOCK_Z] + _ON_TABLE_SIGMA_M**2
        if self.block_is_near or above**2 > _CLEARLY**2 * known:
            return
        row = np.zeros((1, self._lasting.size))
        row[0, BLOCK_Z] = 1.0
        self.estimate.update(row, np.array([-above]), np.array([[_ON_TABLE_SIGMA_M**2]]))

    def _place(self, sighting: Sighting) -> None:
        """First sight of block or container: where the pixel's ray meets the table."""
        camera = self.camera(sighting.view)
        found = camera.ray_at_height(sighting.pixels[0], rest_height(sighting.thing))
        where = place_of(sighting.thing)
        self.state[where] = found[: where.stop - where.start]
        self.estimate.forget(slice(where.start, where.start + 2), 0.01)

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
                self._start_anew(thing, [one for one in surprising if one.thing is thing])

    def _take_expected(self, sighting: Sighting) -> bool:
        """True if the sighting entered, False if it surprises."""
        if not self.seen[sighting.thing] and sighting.thing is not Thing.TOOL:
            self._place(sighting)
        self.seen[sighting.thing] = True
        rows, gaps = self._compare(sighting)
        noise = self._noise(rows, sighting.sigma_px)
        if self.estimate.surprise(rows, gaps, noise) > _SURPRISE * len(gaps) / 2:
            return False
        self._update(sighting.view, rows, gaps, noise)
        return True

    def _start_anew(self, thing: Thing, sightings: Sequence[Sighting]) -> None:
        """Start anew with what is seen: the thing is not where it was believed to be.

        What lies on the table is placed as at first sight, however far away it was believed to be.
        """
        self._surprises[thing] = 0
        if thing is not Thing.TOOL and not (thing is Thing.BLOCK and self.block_is_near):
            self.seen[thing] = False
            for sighting in sightings:
                self._take_expected(sighting)
            return
        where = place_of(thing)
        self.covariance[where, where] += np.eye(where.stop - where.start) * _LOST_SIGMA_M**2
        for sighting in sightings:
            self.estimate.forget(self._lasting.of(sighting.view, thing, sighting.cue), 1.0)
            rows, gaps = self._compare(sighting)
            self._update(sighting.view, rows, gaps, self._noise(rows, sighting.sigma_px))

    def take_heading(self, sighting: HeadingSighting) -> None:
        """The block's yaw against the tool's; a square looks the same after a quarter turn."""
        row = np.zeros((1, self._lasting.size))
        row[0, BLOCK_YAW], row[0, TOOL_YAW] = 1.0, -1.0
        error = self._lasting.of_heading(sighting.view)
        row[0, error] = sighting.lasting
        if sighting.lying is not self.lies:
            self._tumble(sighting)
            return
        self._tumbled = 0
        period = 2.0 * _QUARTER if self.lies else _QUARTER
        gap = sighting.heading - (self.block_yaw - self.tool_yaw)
        gap = (gap + period / 2) % period - period / 2
        self._update(sighting.view, row, np.array([gap]), np.array([[sighting.sigma**2]]))

    def _tumble(self, sighting: HeadingSighting) -> None:
        """The block seems to lie where it stood, or to stand: believed when it lasts."""
        self._tumbled += 1
        if self._tumbled < _SURPRISES:
            return
        self._tumbled, self.lies = 0, sighting.lying
        self.state[BLOCK_YAW] = self.tool_yaw + sighting.heading
        sigma = math.hypot(sighting.sigma, sighting.lasting)
        self.estimate.forget(slice(BLOCK_YAW, BLOCK_YAW + 1), sigma)

    def shares(self, gap: Matrix) -> dict[str, float]:
        """Each view's contribution in the last glance to knowing `gap`; they sum to 1.

        A view's part of the posterior covariance P: P I P, where I is the information it brought.
        Empty when none brought any.
        """
        rows = gap @ self.estimate.covariance[:SIZE]
        parts = {
            view: float(np.trace(rows @ information @ rows.T))
            for view, information in self._information.items()
        }
        whole = sum(parts.values())
        return {view: part / whole for view, part in parts.items()} if whole > 0.0 else {}

    def _compare(self, sighting: Sighting) -> tuple[Matrix, Vector]:
        """Jacobian, shape (2n, state), and what was seen minus what was expected [px]."""
        camera, thing = self.camera(sighting.view), sighting.thing
        turn = self.tool_axes if thing is Thing.TOOL else np.eye(3)
        centre = np.zeros(3)
        centre[: place_of(thing).stop - place_of(thing).start] = self.state[place_of(thing)]
        points = centre + sighting.points @ turn.T
        errors = self._lasting.of(sighting.view, thing, sighting.cue)
        slopes = self._lasting.slopes(sighting, errors)
        gaps = (sighting.pixels - camera.project(points)).ravel()
        rows = np.zeros((len(gaps), self._lasting.size))
        rows[:, errors] = slopes
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

    def _noise(self, rows: Matrix, sigma_px: float) -> Matrix:
        """Covariance of what is seen [px²]: each coordinate's own, and what moved meanwhile."""
        meanwhile = rows @ self._velocity * _NOT_AT_ONCE_S
        return np.eye(len(rows)) * sigma_px**2 + np.outer(meanwhile, meanwhile)

    def _update(self, view: str, rows: Matrix, gaps: Vector, noise: Matrix) -> None:
        self.estimate.update(rows, gaps, noise)
        brought = rows.T @ np.linalg.solve(noise, rows)
        self._information[view] = self._information.get(view, 0.0) + brought

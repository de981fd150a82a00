"""The numbers a belief is made of: where each of them stands in the filter's state."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from hw.sim.layout import BLOCK_HEIGHT_M
from hw.sim.vision.detections import Thing
from hw.sim.vision.pinhole import Matrix
from tams_app.records import Vector

# The tool's turn: tilts about the base frame's x and y, then the yaw.
TOOL, TURN, BLOCK, BLOCK_YAW, CONTAINER = slice(0, 3), slice(3, 6), slice(6, 9), 9, slice(10, 12)
TOOL_YAW, BLOCK_Z = TURN.stop - 1, BLOCK.stop - 1
SIZE = 12


@dataclass(frozen=True, slots=True)
class Gap:
    """A direction of interest: rows over the state, shape (n, SIZE)."""

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

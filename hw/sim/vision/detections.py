"""What one glance at the views yields, in pixels, each with an uncertainty measured in them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from hw.sim.vision.pinhole import Matrix


class Thing(StrEnum):
    """What the operator looks for."""

    TOOL = "tool"
    BLOCK = "block"
    CONTAINER = "container"


@dataclass(frozen=True, slots=True)
class Sighting:
    """Points of a thing found in a view.

    `pixels`, shape (n, 2), show `points`, shape (n, 3) [m]: for the tool in its own frame, for
    block and container away from their centres along the base frame's axes. `sigma_px`: of each
    coordinate.
    """

    view: str
    thing: Thing
    pixels: Matrix
    points: Matrix
    sigma_px: float


@dataclass(frozen=True, slots=True)
class HeadingSighting:
    """The block's yaw against the tool's as the wrist camera shows it [rad].

    Modulo a quarter turn where it stands, of its long side and modulo half a turn where it lies.
    """

    view: str
    heading: float
    sigma: float
    lying: bool = False


@dataclass(frozen=True, slots=True)
class Glance:
    """All that one look at the pictures yields; `fingers_opening` [m] None when not made out."""

    sightings: tuple[Sighting, ...]
    headings: tuple[HeadingSighting, ...]
    fingers_opening: float | None

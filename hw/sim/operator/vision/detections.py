"""The detections of one glance at the views, in pixels, each with a measured uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from hw.sim.operator.vision.pinhole import Matrix


class Thing(StrEnum):
    """A thing that the operator looks for."""

    TOOL = "tool"
    BLOCK = "block"
    CONTAINER = "container"


class Cue(StrEnum):
    """The sign that a thing was recognised by; each errs in its own way."""

    COLOUR = "colour"
    MARKER = "marker"
    MARKER_AHEAD = "marker ahead"  # the gripper's three
    MARKER_LEFT = "marker left"
    MARKER_RIGHT = "marker right"


@dataclass(frozen=True, slots=True)
class Sighting:
    """Points of a thing found in a view.

    `pixels`, shape (n, 2), show `points`, shape (n, 3) [m]: for the tool in its own frame, for
    block and container away from their centres along the base frame's axes.

    Standard deviations: `sigma_px` of each coordinate by itself, anew in every glance, and what
    the next glances at the same image repeat: `lasting_px` of a shift that all points share, and
    `warp_px` of each one's shift by a stretch and shear of the whole (blur draws a marker's corners
    inwards). Looking again helps against the first only.
    """

    view: str
    thing: Thing
    pixels: Matrix
    points: Matrix
    sigma_px: float
    lasting_px: float = 0.0
    warp_px: float = 0.0
    cue: Cue = Cue.COLOUR


@dataclass(frozen=True, slots=True)
class HeadingSighting:
    """The block's yaw against the tool's as the wrist camera shows it [rad].

    Modulo a quarter turn where it stands, of its long side and modulo half a turn where it lies.
    `lasting` as a sighting's `lasting_px`.
    """

    view: str
    heading: float
    sigma: float
    lying: bool = False
    lasting: float = 0.0


@dataclass(frozen=True, slots=True)
class Glance:
    """All that one look at the images yields; `fingers_opening` [m] None when not made out."""

    sightings: tuple[Sighting, ...]
    headings: tuple[HeadingSighting, ...]
    fingers_opening: float | None

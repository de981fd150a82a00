"""An outline of where the arm is now, over a late picture of a camera that stands still."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.prediction.plane_warp import corners_of, inverse, mounted, silhouette
from tams_app.records import ArmFigure, Image, Lens, Pose, Solid, Vector
from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Points: TypeAlias = NDArray[np.float64]

_CAUGHT_UP_PX = 3.0  # nearer than this to where the picture shows it there is nothing to tell
_LED_PX = 6.0  # nearer than this to where it is now, where it is led is not marked
_CROSS_PX = 13
_LINE, _EDGE = 250, 20  # grey levels: light, with a dark edge that makes it visible on anything
_WIDTHS = ((_EDGE, 3), (_LINE, 1))
_BORDER = (np.s_[:4], np.s_[-4:], np.s_[:, :4], np.s_[:, -4:])  # of a picture
_BASE = Pose(np.zeros(3), Rotation.identity())
_SAME_M = 1e-6
_STRAIGHT_PX = 0.5  # from this line


@dataclass(frozen=True, slots=True)
class ArmLink:
    """What moves with a joint about the z axis of its frame.

    place: of that frame on the link before (the first: on the base) at joint angle 0.
    """

    place: Pose
    solids: tuple[Solid, ...]


@dataclass(frozen=True, slots=True)
class PlacedArm:
    """Where the arm is.

    mount: what the tool moves with, base frame. joints: [rad], shape (6,); None: not known.
    """

    mount: Pose
    joints: Vector | None = None


def links_of(figure: ArmFigure) -> tuple[ArmLink, ...]:
    """The links between base and flange; none of an arm that is no chain of such joints."""
    at_zero = figure.place(np.zeros(6))
    names, before, links = list(at_zero), _BASE, []
    for name in names:
        place = mounted(inverse(before), at_zero[name])
        links.append(ArmLink(place, tuple(figure.solids.get(name, ()))))
        before = at_zero[name]
    bent = np.linspace(0.3, 0.8, 6)
    follows = len(links) == len(bent) and all(
        _is_same(pose, figure.place(bent)[name])
        for name, pose in zip(names, _frames(links, bent), strict=True)
    )
    return tuple(links[:-1]) if follows and names[-1] == figure.flange else ()


class ArmOutline:
    """Draws the outline of the arm as `lens`, which is mounted on the base, sees it.

    A cross marks where the hand is leading the tip; it follows the hand without the arm's lag.
    """

    def __init__(
        self, lens: Lens, tool: Iterable[Solid], tip: Floats3 = ZERO, links: Iterable[ArmLink] = ()
    ) -> None:
        """What moves with the flange, in whose frame `tip` is, its TCP [m]; `links` before it."""
        self._lens, self._tip, self._links = lens, np.array(tip), tuple(links)
        self._hulls = [_Hulls(tuple(tool)), *(_Hulls(link.solids) for link in self._links)]

    def over(self, image: Image, then: PlacedArm, now: PlacedArm, led_to: Pose) -> Image | None:
        """`image` with the outline of `now`, and the cross where the flange is led to.

        Grey or BGR; the image itself stays as it is. No outline of what is within 3 pixels of where
        it was `then`, no cross within 6 of `now`; None where there is neither.
        """
        moved = list(self._moved(then, now))
        here, there = (self._pixels(pose, self._tip[None]) for pose in (now.mount, led_to))
        is_led = len(here) == len(there) == 1 and _apart_px(here, there) > _LED_PX
        if not (moved or is_led):
            return None
        drawn = image.copy()
        if moved:
            self._draw(moved, drawn)
            for side in _BORDER:  # an arm that leaves the picture does not end there
                drawn[side] = image[side]
        if is_led:
            x, y = np.rint(there[0]).astype(int).tolist()
            for grey, width in _WIDTHS:
                cv2.drawMarker(drawn, (x, y), (grey,) * 3, cv2.MARKER_CROSS, _CROSS_PX, width)
        return drawn

    def _draw(self, hulls: Sequence[Points], image: Image) -> None:
        shape = silhouette(hulls, self._lens)
        contours, _ = cv2.findContours(shape, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        # a line costs by its corners
        few = [cv2.approxPolyDP(contour, _STRAIGHT_PX, closed=True) for contour in contours]
        for grey, width in _WIDTHS:
            cv2.drawContours(image, few, -1, (grey,) * 3, width, cv2.LINE_AA)

    def _moved(self, then: PlacedArm, now: PlacedArm) -> Iterator[Points]:
        """The solids' corners where they are now, of the links that have moved in the picture."""
        for was_at, is_at, hulls in zip(
            self._places(then), self._places(now), self._hulls, strict=False
        ):
            was, is_now = (self._pixels(pose, hulls.points) for pose in (was_at, is_at))
            if len(was) != len(is_now) or _apart_px(was, is_now) > _CAUGHT_UP_PX:
                yield from np.split(_mounted(is_at, hulls.points), hulls.ends)

    def _places(self, arm: PlacedArm) -> Iterator[Pose]:
        """Of the flange, and of the links where they are known."""
        yield arm.mount
        if arm.joints is not None:
            yield from _frames(self._links, arm.joints)

    def _pixels(self, frame: Pose, points: Points) -> Points:
        return self._lens.projected(_mounted(frame, points))


class _Hulls:
    """The corners of solids in a link's frame, shape (n, 3), and where each but the last ends."""

    def __init__(self, solids: tuple[Solid, ...]) -> None:
        each = [corners_of(solid) for solid in solids]
        self.points = np.concatenate([np.empty((0, 3)), *each])
        self.ends = np.cumsum([len(corners) for corners in each])[:-1]


def _mounted(frame: Pose, points: Points) -> Points:
    return np.asarray(frame.position + points @ frame.rotation.as_matrix().T)


def _frames(links: Sequence[ArmLink], joints: Vector) -> Iterator[Pose]:
    """In the base frame, with the first of `joints` [rad]."""
    pose = _BASE
    for link, angle in zip(links, joints.tolist(), strict=False):
        turned = Rotation.from_rotvec((0.0, 0.0, angle))
        pose = mounted(mounted(pose, link.place), Pose(np.zeros(3), turned))
        yield pose


def _is_same(one: Pose, other: Pose) -> bool:
    """Of frames, by points on their axes a metre out."""
    ends = [_mounted(pose, np.eye(3)) for pose in (one, other)]
    return float(np.abs(ends[0] - ends[1]).max()) < _SAME_M


def _apart_px(one: Points, other: Points) -> float:
    """How far corresponding pixels are apart at most, along the rows or the columns."""
    return float(np.abs(one - other).max(initial=0.0))

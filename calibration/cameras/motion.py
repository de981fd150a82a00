"""In front of which camera something moves: frame differences that lamps and noise do not fool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image

_SIZE = (160, 120)  # width, height: averaging takes an image's noise down and keeps a hand
_MAD_TO_SIGMA = 1.4826  # of a normal distribution
_SIGMAS = 5.0
_LEAST_GREYS = 6.0  # what compression alone changes from image to image
_CLEAR_SHARE = 0.04  # of the image, in the mean of the window
_CLEAR_RATIO = 3.0  # times what the next camera sees
_FEWEST_FRAMES = 15

Grey = NDArray[np.float32]


class MotionMeter:
    """One camera's share of the image that moves, from one image to the next.

    `rest` with images of a scene at rest first: it learns the noise. Changes that a whole row
    has in common (the lamp, the automatic exposure: a gain) do not count.
    """

    def __init__(self) -> None:
        self._before: Grey | None = None
        self._sigma = 0.0
        self._resting: list[float] = []

    def rest(self, image: Image) -> None:
        """An image, BGR, while nothing moves."""
        change = self._change(image)
        if change is not None:
            self._sigma = max(self._sigma, _MAD_TO_SIGMA * float(np.median(np.abs(change))))
            self._resting.append(self._share(change))

    def moved(self, image: Image) -> float:
        """The share of the image, 0 to 1, that moves now beyond what it did at rest."""
        change = self._change(image)
        if change is None:
            return 0.0
        return max(0.0, self._share(change) - self.resting_share)

    @property
    def resting_share(self) -> float:
        """What moved although nothing should: a clock, a screen, leaves behind a window."""
        return float(np.percentile(self._resting, 90)) if self._resting else 0.0

    def _change(self, image: Image) -> Grey | None:
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        small = cv2.resize(grey, _SIZE, interpolation=cv2.INTER_AREA).astype(np.float32)
        before, self._before = self._before, small
        if before is None:
            return None
        gain = np.median((small + 1) / (before + 1), axis=1, keepdims=True)
        return np.asarray(small - gain * before, np.float32)

    def _share(self, change: Grey) -> float:
        threshold = max(_SIGMAS * self._sigma, _LEAST_GREYS)
        moving = (np.abs(change) > threshold).astype(np.uint8)
        solid = cv2.morphologyEx(moving, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        return float(solid.mean())


@dataclass(frozen=True, slots=True)
class Attribution:
    """The camera something moved in front of, or "" and why it cannot be told."""

    camera: str
    reason: str
    shares: dict[str, float]  # mean share of the image that moved, by camera


def attribute(moved: Mapping[str, Sequence[float]], taken: Mapping[str, str]) -> Attribution:
    """Decide from each camera's shares over one window; `taken`: view by camera, bound already."""
    shares = {name: float(np.mean(seen)) if len(seen) else 0.0 for name, seen in moved.items()}
    blind = [name for name, seen in moved.items() if len(seen) < _FEWEST_FRAMES]
    if len(blind) == len(moved):
        return Attribution("", "no camera gave enough images: look at their cables", shares)
    first, *others = sorted(shares, key=lambda name: shares[name], reverse=True)
    if shares[first] < _CLEAR_SHARE:
        best = f"{100 * shares[first]:.1f} % of the image at most"
        return Attribution(
            "", f"hardly anything moved ({best}): wave a hand right before the lens", shares
        )
    rivals = [name for name in others if shares[first] < _CLEAR_RATIO * shares[name]]
    if rivals:
        names = " and ".join([first, *rivals])
        return Attribution(
            "", f"{names} all saw it: stay close before one lens, out of the others' sight", shares
        )
    if first in taken:
        return Attribution(
            "", f"that is {first}, which is {taken[first].upper()} already: go to another", shares
        )
    return Attribution(first, "", shares)

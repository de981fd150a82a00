"""Which camera is which view: the person waves before each, and the frames that change show it."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text

from calibration.cameras.bench import Bench, Task, agreed, until_done
from calibration.kit import WizardUI, bar, table
from tams_app.errors import DeviceError
from tams_app.records import Image

_STEP_BACK_S = 8.0
_REST_S = 2.0
_WINDOW_S = 1.5
_STEP_S = 0.5
_WAITING_S = 15.0
_BAR = 30
NAMES = {"eih": "eye in hand (EIH)", "gt": "global top (GT)", "gs": "global side (GS)"}
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
    """The camera something moved in front of, or "" and why it cannot be determined."""

    camera: str
    reason: str
    shares: dict[str, float]  # mean share of the image that moved, by camera


def attribute(moved: Mapping[str, Sequence[float]], taken: Mapping[str, str]) -> Attribution:
    """Decide from each camera's shares over one window; `taken`: view by camera, bound already."""
    shares = {name: float(np.mean(seen)) if len(seen) else 0.0 for name, seen in moved.items()}

    def unclear(reason: str) -> Attribution:
        return Attribution("", reason, shares)

    blind = [name for name, seen in moved.items() if len(seen) < _FEWEST_FRAMES]
    if len(blind) == len(moved):
        return unclear("no camera gave enough images: look at their cables")
    first, *others = sorted(shares, key=shares.__getitem__, reverse=True)
    if shares[first] < _CLEAR_SHARE:
        best = f"{100 * shares[first]:.1f} % of the image at most"
        return unclear(f"hardly anything moved ({best}): wave a hand right before the lens")
    rivals = [name for name in others if shares[first] < _CLEAR_RATIO * shares[name]]
    if rivals:
        names = " and ".join([first, *rivals])
        return unclear(f"{names} all saw it: stay close before one lens, out of the others' sight")
    if first in taken:
        return unclear(f"that is {first}, which is {taken[first].upper()} already: go to another")
    return Attribution(first, "", shares)


def bind_views(ui: WizardUI, bench: Bench, views: Sequence[str]) -> dict[str, str]:
    """Camera by view; DeviceError if there are too few cameras or the person gives up."""
    for sentence in bench.refused:
        ui.print(f"Left out: {sentence}")
    if len(bench.cameras) < len(views):
        found = ", ".join(bench.cameras) or "none"
        raise DeviceError(
            f"{len(views)} views need as many cameras; those that can be used: {found}"
        )
    ui.print(f"{len(bench.cameras)} cameras: {', '.join(bench.cameras)}.")
    meters = _at_rest(ui, bench)
    taken: dict[str, str] = {}
    for view in views:
        camera = _wait_for_wave(ui, bench, meters, view, taken)
        ui.print(f"{view.upper()} is {camera}.")
        taken[camera] = view
    return {view: camera for camera, view in taken.items()}


def _at_rest(ui: WizardUI, bench: Bench) -> dict[str, MotionMeter]:
    bench.prompt(Task.REST, "")
    if bench.attended:
        ui.print(f"Step out of all images within {_STEP_BACK_S:g} s; Enter if you are out.")
        for _ in until_done(ui, bench, bench.cameras, _STEP_BACK_S):
            pass  # what moves now is not at rest yet
    ui.print(f"Keep out and let everything rest for {_REST_S:g} s.")
    meters = {camera: MotionMeter() for camera in bench.cameras}
    for frame in bench.shots(bench.cameras, _REST_S):
        meters[frame.view].rest(frame.image)
    return meters


def _wait_for_wave(
    ui: WizardUI, bench: Bench, meters: Mapping[str, MotionMeter], view: str, taken: dict[str, str]
) -> str:
    """The camera that was waved before; asks again until it is clear or not wanted."""
    while True:
        ui.print(f"Wave a hand close before the camera {NAMES.get(view, view)}, and only there.")
        bench.prompt(Task.WAVE, view)
        found = _watch(ui, bench, meters, taken)
        if found.camera:
            return found.camera
        ui.print(f"Not clear: {found.reason}.")
        if not agreed(ui, bench, "Try again?"):
            raise DeviceError(f"which camera is {view.upper()} was not found out: {found.reason}")


def _watch(
    ui: WizardUI, bench: Bench, meters: Mapping[str, MotionMeter], taken: dict[str, str]
) -> Attribution:
    length = round(_WINDOW_S * bench.fps)
    moved: dict[str, deque[float]] = {name: deque(maxlen=length) for name in bench.cameras}
    found = attribute(moved, taken)
    for _ in range(round(_WAITING_S / _STEP_S)):
        for frame in bench.shots(bench.cameras, _STEP_S):
            moved[frame.view].append(meters[frame.view].moved(frame.image))
        found = attribute({name: list(seen) for name, seen in moved.items()}, taken)
        ui.show(_bars(found.shares, taken))
        if found.camera:
            break
    return found


def _bars(shares: Mapping[str, float], taken: Mapping[str, str]) -> Table:
    return table(
        # the camera's own name may look like markup
        (Text(name), taken.get(name, "").upper(), bar(3 * share, _BAR), f"{share:.0%} moves")
        for name, share in shares.items()
    )

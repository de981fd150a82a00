"""A camera on the arm that is not where it should be is found by the frames that come."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tams_app.prediction.camera_check import APART_NS, COMPARED, CameraCheck
from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.present import MountTrail, WristView
from tams_app.records import Image, Lens, Pose, ShownFrame
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.prediction.wrist import above, lens_of, picture, placed

pytestmark = pytest.mark.untimed

LENS = lens_of(160, 120)
LATE_NS = 150 * NS_PER_MS
FRAME_NS = 100 * NS_PER_MS
FINER = 5.0  # than it is elsewhere: waves of 2 and 3 cm, as on a table with things on it
Path = Callable[[float], Pose]


def to_and_fro(t_s: float) -> Pose:
    """As an arm goes over a table, with turns."""
    turn = Rotation.from_rotvec((0.0, 0.0, 0.2 * np.sin(1.1 * t_s)))
    x, y = 0.10 * np.sin(1.3 * t_s), 0.08 * np.sin(1.7 * t_s)
    return above(x, y, 0.2 + 0.03 * np.sin(t_s), turn)


def slowly(t_s: float) -> Pose:
    return above(0.02 * t_s, 0.0, 0.2)


def still(_t_s: float) -> Pose:
    return above(0.0, 0.0, 0.2)


def turned(*turn_deg: float) -> Lens:
    pose = LENS.pose
    turn = Rotation.from_rotvec(tuple(np.radians(turn_deg)))
    return replace(LENS, pose=Pose(pose.position, pose.rotation * turn))


def shifted(*move_m: float) -> Lens:
    pose = LENS.pose
    return replace(LENS, pose=Pose(pose.position + np.array(move_m), pose.rotation))


class Session:
    """Frames of a camera at `LENS`, and a check that takes it to be elsewhere."""

    def __init__(self, believed: Lens = LENS, path: Path = to_and_fro) -> None:
        self.trail, self._path = MountTrail(), path
        self.check = CameraCheck(WristView(WristWarp(believed, ()), self.trail))
        self.found_s: list[float] = []
        self._index = 0

    def run(
        self,
        seconds: float,
        change: Callable[[Image], Image] = lambda image: image,
        whole: bool = True,
    ) -> None:
        """A frame each 100 ms, states as late as it; when the camera was found wrong is kept."""
        for _ in range(round(seconds * NS_PER_S / FRAME_NS)):
            self._index += 1
            capture_ns = self._index * FRAME_NS
            now_ns = capture_ns + LATE_NS
            pose = self._path(capture_ns / NS_PER_S)
            self.trail.add(placed(now_ns, pose, pose, late_ns=LATE_NS))
            image = change(picture(LENS, pose, FINER))
            if self.check.shown(ShownFrame("eih", self._index, now_ns, image, capture_ns, whole)):
                self.found_s.append(now_ns / NS_PER_S)


def test_a_camera_that_is_where_it_should_be_fits_however_long() -> None:
    session = Session()
    session.run(30.0)
    assert session.check.fits
    assert session.check.judged > 20
    assert session.check.left < 0.3


@pytest.mark.parametrize(
    "believed",
    [
        turned(0.0, 0.0, 20.0),
        turned(0.0, 0.0, 180.0),
        turned(20.0, 0.0, 0.0),
        turned(0.0, 20.0, 0.0),
        shifted(0.0, 0.0, 0.08),
        replace(LENS, fx=LENS.fx / 1.7, fy=LENS.fy / 1.7),
        replace(LENS, fx=1.6 * LENS.fx, fy=1.6 * LENS.fy),
    ],
    ids=["rolled", "upside down", "tilted", "panned", "too near", "too wide", "too narrow"],
)
def test_a_camera_that_is_not_is_found_once_within_seconds_of_motion(believed: Lens) -> None:
    session = Session(believed)
    session.run(20.0)
    assert not session.check.fits
    assert len(session.found_s) == 1
    assert session.found_s[0] < 15.0


def test_mirrored_frames_are_found() -> None:
    session = Session()
    session.run(20.0, lambda image: np.asarray(cv2.flip(image, 1), np.uint8))
    assert len(session.found_s) == 1


def test_one_comparison_a_second_is_made_and_none_is_judged_alone() -> None:
    session = Session(turned(0.0, 0.0, 180.0))
    session.run(COMPARED - 1.0)
    assert 1 <= session.check.judged < COMPARED
    assert session.check.fits
    session.run(4.0)
    assert session.check.judged == COMPARED
    assert not session.check.fits


def test_of_a_slow_arm_frames_are_compared_that_are_further_apart() -> None:
    right, wrong = Session(path=slowly), Session(turned(0.0, 0.0, 30.0), slowly)
    for session in (right, wrong):
        session.run(12.0)
    assert right.check.judged > COMPARED
    assert right.check.fits
    assert not wrong.check.fits


def bare(image: Image) -> Image:
    noise = np.random.default_rng(int(image[0, 0, 0]))
    return np.asarray(120 + noise.integers(-3, 4, image.shape), np.uint8)


@pytest.mark.parametrize("why", ["at rest", "bare table", "not whole", "arm not known"])
def test_frames_that_tell_nothing_are_not_judged(why: str) -> None:
    session = Session(turned(0.0, 0.0, 180.0), still if why == "at rest" else to_and_fro)
    if why == "arm not known":
        session.trail = MountTrail()  # what is told from now on does not reach the check
    session.run(20.0, bare if why == "bare table" else np.asarray, whole=why != "not whole")
    assert session.check.fits
    assert session.check.judged == 0
    assert session.check.left is None


def test_frames_that_are_further_apart_are_not_compared() -> None:
    """After a gap in the video they show different places."""
    session = Session(turned(0.0, 0.0, 180.0))
    frames = []
    session.run(0.1)
    for step in range(1, 40):
        capture_ns = step * 4 * APART_NS
        pose = to_and_fro(capture_ns / NS_PER_S)
        session.trail.add(placed(capture_ns + LATE_NS, pose, pose, late_ns=LATE_NS))
        frames.append(
            ShownFrame("eih", step, capture_ns, picture(LENS, pose, FINER), capture_ns, True)
        )
    for frame in frames:
        session.check.shown(frame)
    assert session.check.judged == 0

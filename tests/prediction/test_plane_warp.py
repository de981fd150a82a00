import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.prediction.plane_warp import (
    WristWarp,
    border_rays,
    covered_by,
    mounted,
    plane_change,
)
from tams_app.records import Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tests.prediction.wrist import above, lens_of, picture
from tests.teleop.motions import within

pytestmark = pytest.mark.untimed

LENS = lens_of(64, 48)
BARE: tuple[Solid, ...] = ()

heights = st.floats(0.1, 0.5)
turns = within(0.3).map(Rotation.from_rotvec)


def change(then: Pose, now: Pose) -> np.ndarray | None:
    return plane_change(border_rays(LENS), then, now)


def ray(camera: Pose, point: np.ndarray) -> np.ndarray:
    """Where `camera` sees a point of the base frame, one metre before it."""
    seen = camera.rotation.inv().apply(point - camera.position)
    return seen / seen[2]


@given(heights, heights, turns, turns, within(0.1))
def test_a_point_of_the_plane_was_where_the_change_of_its_ray_says(z0, z1, turn0, turn1, way):
    then, now = above(0.0, 0.0, z0, turn0), above(way[0], way[1], z1, turn1)
    found = change(then, now)
    for x, y in ((0.0, 0.0), (0.02, -0.03), (-0.05, 0.04)):
        point = np.array([x, y, 0.0])
        before = found @ ray(now, point)
        assert before / before[2] == pytest.approx(ray(then, point), abs=1e-7)


def test_a_camera_that_sees_the_horizon_is_not_corrected():
    level = above(0.0, 0.0, 0.2)
    for angle in (1.2, -1.2):
        tilted = above(0.0, 0.0, 0.2, Rotation.from_rotvec((angle, 0.0, 0.0)))
        assert change(level, tilted) is None
        assert change(tilted, level) is None


def test_a_camera_at_the_plane_is_not_corrected():
    high, least, low = (above(0.0, 0.0, z) for z in (0.2, 0.021, 0.019))
    assert change(high, low) is None
    assert change(low, high) is None
    assert change(high, least) is not None


def test_a_mount_turns_and_moves_with_what_it_is_mounted_on():
    mount = Pose(np.array([0.1, 0.0, 0.0]), Rotation.from_rotvec((0.0, 0.0, 0.5)))
    place = Pose(np.array([1.0, 2.0, 3.0]), Rotation.from_rotvec((0.0, 0.0, np.pi / 2)))
    found = mounted(place, mount)
    assert found.position == pytest.approx([1.0, 2.1, 3.0])
    assert found.rotation.as_rotvec() == pytest.approx((0.0, 0.0, np.pi / 2 + 0.5))


FINGER = Solid(
    SolidKind.BOX,
    Pose(np.array([0.0, 0.05, 0.06]), Rotation.identity()),
    (0.02, 0.02, 0.02),
    (0.0, 0.0, 0.0),
)


def test_the_tool_stays_where_it_is_in_the_picture_and_what_was_behind_it_is_not_seen():
    then, now = above(0.0, 0.0, 0.20), above(0.03, 0.0, 0.20)
    frame = picture(LENS, then)
    bare = WristWarp(LENS, BARE).to_now(frame, then, now)
    covered = covered_by((FINGER,), LENS)
    frame[covered] = (0, 0, 200)
    warped = WristWarp(LENS, (FINGER,)).to_now(frame, then, now)
    assert bare is not None
    assert (warped[covered] == (0, 0, 200)).all()
    assert not (warped[~covered] == (0, 0, 200)).all(axis=1).any()  # no second one beside it
    assert ((warped == 64) & (bare != 64)).all(axis=2).any()
    still = WristWarp(LENS, (FINGER,)).to_now(frame, then, then)
    assert (still == frame).all()  # what is not late stays, and the tool counts as seen


@pytest.mark.parametrize("kind", SolidKind)
def test_a_solid_covers_its_outline_and_a_margin(kind):
    solid = Solid(kind, Pose(np.array([0.0, 0.05, 0.10]), Rotation.identity()), (0.04,) * 3,
                  (0.0, 0.0, 0.0))  # fmt: skip
    covered = covered_by((solid,), LENS)
    half = LENS.fy * 0.02 / 0.08  # of its near side [px]
    middle = (LENS.height - 1) / 2
    rows = np.flatnonzero(covered.any(axis=1))
    assert rows[0] == pytest.approx(middle - half - 3, abs=1.5)
    assert rows[-1] == pytest.approx(middle + half + 3, abs=1.5)


def test_a_solid_behind_the_camera_covers_nothing():
    behind = Solid(SolidKind.BOX, Pose(np.array([0.0, 0.05, -0.2]), Rotation.identity()),
                   (0.05,) * 3, (0.0, 0.0, 0.0))  # fmt: skip
    assert not covered_by((behind,), LENS).any()

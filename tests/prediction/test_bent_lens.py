"""A lens that distorts: its rays and pixels, and what is predicted through it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.prediction.outline import ArmOutline, PlacedArm
from tams_app.prediction.plane_warp import (
    RayMap,
    WristWarp,
    border_rays,
    corners_of,
    mounted,
    plane_change,
    silhouette,
)
from tams_app.records import NO_DISTORTION, Lens, Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tests.prediction.wrist import MOUNT, STRAIGHT, above, lens_of, picture
from tests.teleop.motions import within

pytestmark = pytest.mark.untimed

WIDE = Lens("flange", MOUNT, 412.0, 409.0, 331.0, 228.0, 640, 480,
            (-0.32, 0.11, 0.0012, -0.0008, -0.015))  # fmt: skip
TELE = replace(WIDE, fx=900.0, fy=905.0, distortion=(0.12, 0.05, -0.001, 0.0005, 0.0))

bent = st.builds(
    lambda fx, ratio, cx, cy, k1, k2, p1, p2: Lens(
        "base", MOUNT, fx, fx * ratio, cx, cy, 640, 480, (k1, k2, p1, p2, 0.0)
    ),
    st.floats(380, 1500), st.floats(0.97, 1.03), st.floats(290, 350), st.floats(210, 270),
    st.floats(-0.3, 0.2), st.floats(0.0, 0.1), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3),
).filter(lambda lens: lens.is_invertible)  # fmt: skip


@given(bent, st.floats(-0.5, 639.5), st.floats(-0.5, 479.5))
def test_a_pixel_s_ray_leads_back_to_it(lens, x, y):
    there_and_back = lens.pixels(lens.slopes(np.array([(x, y)])))
    assert there_and_back[0] == pytest.approx((x, y), abs=1e-4)


@given(bent, within(0.15))
def test_what_is_in_the_picture_is_where_opencv_has_it(lens, place):
    point = np.array([(place[0], place[1], 0.4)])
    expected, _ = cv2.projectPoints(
        point, np.zeros(3), np.zeros(3), lens.matrix(), np.array(lens.distortion)
    )
    seen = lens.pixels(point[:, :2] / 0.4)
    size = np.array((lens.width, lens.height))
    if ((seen > 0.0) & (seen < size - 1.0)).all():
        assert seen[0] == pytest.approx(expected[0, 0], abs=1e-6)


@given(bent, st.floats(0.0, 6.28))
def test_what_is_beside_the_picture_never_comes_to_be_in_it(lens, angle):
    """The polynomial alone turns back: at three times the corner it has it in the middle again."""
    way = np.array((np.cos(angle), np.sin(angle)))
    middle = np.array((lens.cx, lens.cy))
    out = lens.pixels(np.linspace(0.0, 20.0, 400)[:, None] * way) - middle
    far = np.linalg.norm(out, axis=1)
    assert (np.diff(far) > 0.0).all()


def test_a_lens_that_turns_back_within_its_picture_is_told_from_one_that_does_not():
    assert WIDE.is_invertible
    assert TELE.is_invertible
    assert lens_of(64, 48).is_invertible
    assert not replace(WIDE, distortion=(-0.9, 0.0, 0.0, 0.0, 0.0)).is_invertible


@given(bent, st.floats(0.2, 3.0), within(0.3))
def test_a_smaller_picture_shows_the_same_point_at_the_same_share_of_it(lens, scale, place):
    width, height = round(160 * scale) * 4, round(160 * scale) * 3
    slopes = np.array([(place[0], place[1])])
    scaled = lens.scaled_to(width, height)
    assert lens.scaled_to(width, height * 3 // 4) is None
    small = scaled.pixels(slopes) + 0.5
    large = lens.pixels(slopes) + 0.5
    assert small / (width, height) == pytest.approx(large / (640, 480), abs=1e-9)


THEN, NOW = (
    above(0.0, 0.0, 0.20),
    above(0.015, -0.01, 0.17, Rotation.from_rotvec((0.05, -0.04, 0.1))),
)


@pytest.mark.parametrize("lens", [WIDE, TELE])
def test_a_frame_of_the_plane_becomes_what_the_bent_lens_sees_now(lens):
    late, true = (picture(lens, flange) for flange in (THEN, NOW))
    warped = WristWarp(lens, ()).to_now(late, THEN, NOW)
    seen = (warped != 64).any(axis=2)
    apart = np.abs(warped.astype(int) - true)[seen]
    assert np.percentile(apart, 99) <= 2
    straight = WristWarp(replace(lens, distortion=(0.0,) * 5), ()).to_now(late, THEN, NOW)
    both = seen & (straight != 64).any(axis=2)
    assert np.abs(straight.astype(int) - true)[both].mean() > 1.5 * apart.mean()


@pytest.mark.parametrize("lens", [WIDE, TELE, replace(WIDE, distortion=NO_DISTORTION)])
def test_the_mesh_puts_each_pixel_within_a_twentieth_of_where_it_belongs(lens):
    then, now = (mounted(flange, lens.pose) for flange in (THEN, NOW))
    change = plane_change(border_rays(lens), then, now)
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 2)
    rays = np.insert(lens.slopes(pixels), 2, 1.0, axis=1) @ change.T
    exact = lens.pixels(rays[:, :2] / rays[:, 2:]).reshape(480, 640, 2)
    inside = ((exact > 1) & (exact < (638, 478))).all(axis=-1)
    assert np.abs(RayMap(lens).places(change) - exact)[inside].max() < 0.05


def test_a_bent_edge_is_filled_up_to_where_its_points_are_projected():
    solid = Solid(SolidKind.BOX, Pose(np.array([0.02, 0.03, 0.15]), STRAIGHT),
                  (0.18, 0.12, 0.0001), (0.0, 0.0, 0.0))  # fmt: skip
    lens = replace(WIDE, pose=Pose(np.zeros(3), STRAIGHT))
    shape = silhouette([corners_of(solid)], lens)
    along = np.linspace(-0.09, 0.09, 50)
    for inside, there in ((0.059, 255), (0.061, 0)):
        edge = np.column_stack((along, np.full(50, -inside), np.zeros(50)))
        pixels = np.rint(lens.projected(solid.pose.position + edge)).astype(int)
        seen = pixels[(pixels >= 0).all(axis=1) & (pixels < (640, 480)).all(axis=1)][2:-2]
        assert len(seen) > 20
        assert (shape[seen[:, 1], seen[:, 0]] == there).all()


def test_a_tool_far_beside_the_picture_of_a_bent_lens_draws_nothing():
    tool = Solid(SolidKind.BOX, Pose(np.zeros(3), STRAIGHT), (0.02,) * 3, (0.0, 0.0, 0.0))
    looks_down = replace(WIDE, parent="base", pose=above(0.0, 0.0, 0.8))
    image = np.full((480, 640), 120, np.uint8)
    drawn = ArmOutline(looks_down, [tool]).over(
        image,
        PlacedArm(above(0.0, 0.0, 0.2)),
        PlacedArm(above(2.5, 0.0, 0.2)),
        above(2.5, 0.0, 0.2),
    )
    assert (drawn == image).all()

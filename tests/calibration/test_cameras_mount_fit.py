"""Where cameras are, from corners of the board, against where they were put."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from calibration.cameras.mount_fit import (
    NoMountError,
    Placed,
    fit_fixed,
    fit_hand_eye,
    turns_problem,
)
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tests.calibration.board_views import BOARD, GT, LENS, MOUNT, arm_views, placed_views
from tests.teleop.motions import within

pytestmark = pytest.mark.untimed


def apart(found: Pose, true: Pose) -> tuple[float, float]:
    """Distance [mm] and angle [degrees]."""
    way = float(np.linalg.norm(found.position - true.position)) * 1000.0
    return way, float(np.degrees((found.rotation.inv() * true.rotation).magnitude()))


@given(within(1.0), within(3.0))
def test_a_pose_and_its_inverse_are_nothing_together(position, turn):
    pose = Pose(np.array(position), Rotation.from_rotvec(turn))
    both = mounted(pose, inverse(pose))
    assert both.position == pytest.approx(np.zeros(3), abs=1e-12)
    assert both.rotation.magnitude() == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=4, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(within(0.1), within(2.5), st.integers(0, 99))
def test_hand_and_eye_find_a_mount_from_poses_and_corners_with_noise(place, turn, seed):
    mount = Pose(np.array(place), Rotation.from_rotvec(turn))
    random = np.random.default_rng(seed)
    found = fit_hand_eye(LENS, list(arm_views(LENS, mount, 16, random, 0.15)))
    millimetres, degrees = apart(found.mount.pose, mount)
    assert millimetres < 1.0
    assert degrees < 0.15
    assert apart(found.board, BOARD)[0] < 1.0
    assert 0.1 < found.mount.error_px < 0.4


def test_the_error_told_is_what_a_prediction_is_off_by_where_the_arm_tells_its_place_badly():
    """0.5 mm and 0.06 degrees, in each direction: errors of an arm's own geometry."""
    random = np.random.default_rng(4)
    views = list(arm_views(LENS, MOUNT, 18, random, 0.1, joint_noise=0.0005))
    found = fit_hand_eye(LENS, views).mount
    fresh = list(arm_views(LENS, MOUNT, 40, random, 0.1, joint_noise=0.0005))
    off = []
    for one in fresh:
        seen = mounted(inverse(mounted(one.flange, found.pose)), BOARD)
        points = seen.position + seen.rotation.apply(one.view.points)
        off.append(LENS.pixels(points[:, :2] / points[:, 2:]) - one.view.pixels)
    rms = float(np.sqrt((np.concatenate(off) ** 2).sum(axis=1).mean()))
    assert found.error_px == pytest.approx(rms, rel=0.35)
    assert found.error_px > 1.0
    assert found.position_sd_mm < 2.0


def test_poses_that_do_not_tell_the_mount_are_refused_with_what_to_do():
    random = np.random.default_rng(1)
    for about, words in (
        ((0.05, 0.05, 0.05), "turned too little"),
        ((0.02, 0.02, 0.9), "about one axis only"),
    ):
        views = list(arm_views(LENS, MOUNT, 16, random, 0.1, about))
        assert words in turns_problem([view.flange for view in views])
        with pytest.raises(NoMountError, match=words):
            fit_hand_eye(LENS, views)
    views = list(arm_views(LENS, MOUNT, 16, random))
    assert turns_problem([view.flange for view in views]) == ""
    with pytest.raises(NoMountError, match="11 poses of the arm, 12 are needed"):
        fit_hand_eye(LENS, views[:11])


def test_a_board_that_was_moved_on_the_way_is_refused():
    random = np.random.default_rng(2)
    views = list(arm_views(LENS, MOUNT, 16, random))
    shifted = Pose(np.array([0.02, 0.0, 0.0]), Rotation.identity())
    half = [type(one)(mounted(shifted, one.flange), one.view) for one in views[8:]]
    with pytest.raises(NoMountError, match="did the board or a camera move"):
        fit_hand_eye(LENS, views[:8] + half)


@settings(max_examples=6, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(st.integers(0, 999))
def test_a_camera_that_stands_still_is_found_from_places_of_the_board(seed):
    random = np.random.default_rng(seed)
    found = fit_fixed(LENS, list(placed_views(random, 0.15)))
    millimetres, degrees = apart(found.pose, GT)
    assert millimetres < 2.5
    assert degrees < 0.3
    assert found.error_px < 0.5


def test_too_few_places_and_places_that_do_not_agree_are_refused():
    random = np.random.default_rng(3)
    places = list(placed_views(random))
    with pytest.raises(NoMountError, match="3 places of the board, 4 are needed"):
        fit_fixed(LENS, places[:3])
    wrong = Placed(places[0].points + np.array((0.03, 0.0, 0.0)), places[0].view)
    with pytest.raises(NoMountError, match="px from where arm and camera have them"):
        fit_fixed(LENS, [wrong, *places[1:]])

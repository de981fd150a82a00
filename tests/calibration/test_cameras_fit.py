"""Lens and mount from corners of the board, against the lens that made them and the true place."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from calibration.cameras import fit
from calibration.cameras.fit import (
    NoFitError,
    PlacedBoard,
    fit_fixed,
    fit_hand_eye,
    fit_lens,
    turns_problem,
)
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation
from tests.calibration.board_views import (
    BOARD,
    GT,
    LENS,
    MOUNT,
    NOWHERE,
    arm_views,
    placed_views,
    shown,
)
from tests.teleop.motions import within

pytestmark = pytest.mark.untimed

GRID = np.stack(np.meshgrid(np.linspace(20, 619, 12), np.linspace(20, 459, 9)), -1).reshape(-1, 2)


def apart_px(found: Lens, true: Lens) -> float:
    """The rms distance in the picture between two lenses, each turned as it fits the other best.

    A turn is the mount's, which is found through the lens and takes it up.
    """
    rays = [np.insert(lens.slopes(GRID), 2, 1.0, axis=1) for lens in (found, true)]
    ours, theirs = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in rays)
    u, _, vt = np.linalg.svd(theirs.T @ ours)
    turned = theirs @ u @ vt
    off = found.pixels(turned[:, :2] / turned[:, 2:]) - GRID
    return float(np.sqrt((off**2).sum(axis=1).mean()))


@settings(max_examples=3, deadline=None, phases=(Phase.explicit, Phase.generate))
@given(
    st.floats(450, 1100), st.floats(-12, 12), st.floats(-12, 12), st.floats(-0.25, 0.1),
    st.integers(0, 99),
)  # fmt: skip
def test_a_lens_is_found_from_what_it_shows(focal, right, down, k1, seed):
    true = Lens("camera", NOWHERE, focal, focal * 1.005, 320 + right, 240 + down, 640, 480,
                (k1, 0.03, 0.0005, -0.0005, 0.0))  # fmt: skip
    found = fit_lens(shown(true, 27, seed), 640, 480)
    assert found.lens.fx == pytest.approx(true.fx, rel=0.01)
    assert found.lens.fy == pytest.approx(true.fy, rel=0.01)
    assert apart_px(found.lens, true) < 1.0


@pytest.mark.parametrize("noise_px", [0.05, 0.5])
def test_the_error_told_is_the_noise_of_the_corners(noise_px):
    found = fit_lens(shown(LENS, 27, 5, noise_px), 640, 480)
    # in the plane: the noise is of each of two coordinates
    assert found.error_px == pytest.approx(noise_px * np.sqrt(2.0), rel=0.15)


def test_a_third_order_is_taken_only_where_it_is_needed():
    assert fit_lens(shown(LENS, 27, 2), 640, 480).lens.distortion[4] == 0.0
    strong = replace(LENS, fx=420.0, fy=420.0, distortion=(-0.28, 0.09, 0.0, 0.0, -0.012))
    found = fit_lens(shown(strong, 27, 2), 640, 480).lens
    assert found.distortion[4] != 0.0
    assert apart_px(found, strong) < 0.4


def test_too_few_views_too_similar_ones_and_a_board_that_is_not_flat_are_refused():
    with pytest.raises(NoFitError, match="11 views of the board, 12 are needed"):
        fit_lens(shown(LENS, 27, 0)[:11], 640, 480)
    for tilt in (0.02, 0.2):
        with pytest.raises(NoFitError, match="tilt the board"):
            fit_lens(shown(LENS, 27, 0, 0.2, tilt=tilt), 640, 480)
    noisy = [replace(view, pixels=view.pixels * (1.0 + 0.01 * (number % 3)) + number)
             for number, view in enumerate(shown(LENS, 27, 0, 1.0))]  # fmt: skip
    with pytest.raises(NoFitError, match="is the board flat"):
        fit_lens(noisy, 640, 480)


@pytest.mark.parametrize(
    ("seen_px", "cause"),
    [
        (285.0, "it bends as a fisheye lens does, which the model cannot describe: take another"),
        (265.0, "no corner of the board was seen there: show the board farther out"),
    ],
)
def test_a_distortion_that_turns_back_is_refused_with_its_one_cause(seen_px, cause):
    """This lens turns back 305 px from its axis, and the picture's corners are 400 px from it."""
    lens = replace(
        LENS, fx=420.0, fy=420.0, cx=319.5, cy=239.5, distortion=(-0.28, 0.0, 0.0, 0.0, 0.0)
    )
    views = [
        replace(view, ids=view.ids[near], points=view.points[near], pixels=view.pixels[near])
        for view in shown(lens, 60, 3)
        for near in [np.linalg.norm(view.pixels - (lens.cx, lens.cy), axis=1) < seen_px]
        if near.sum() >= 8
    ]
    with pytest.raises(NoFitError, match=cause):
        fit_lens(views, 640, 480)


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


@settings(max_examples=2, deadline=None, phases=(Phase.explicit, Phase.generate))
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
        with pytest.raises(NoFitError, match=words):
            fit_hand_eye(LENS, views)
    views = list(arm_views(LENS, MOUNT, 16, random))
    assert turns_problem([view.flange for view in views]) == ""
    with pytest.raises(NoFitError, match="11 poses of the arm, 12 are needed"):
        fit_hand_eye(LENS, views[:11])


def test_a_board_that_was_moved_on_the_way_is_refused(monkeypatch):
    monkeypatch.setattr(fit, "_FOLDS", 2)  # each takes its time
    random = np.random.default_rng(2)
    views = list(arm_views(LENS, MOUNT, 16, random))
    shifted = Pose(np.array([0.02, 0.0, 0.0]), Rotation.identity())
    half = [type(one)(mounted(shifted, one.flange), one.view) for one in views[8:]]
    with pytest.raises(NoFitError, match="did the board or a camera move"):
        fit_hand_eye(LENS, views[:8] + half)


@settings(max_examples=3, deadline=None, phases=(Phase.explicit, Phase.generate))
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
    with pytest.raises(NoFitError, match="3 places of the board, 4 are needed"):
        fit_fixed(LENS, places[:3])
    wrong = PlacedBoard(places[0].points + np.array((0.03, 0.0, 0.0)), places[0].view)
    with pytest.raises(NoFitError, match="px from where arm and camera have them"):
        fit_fixed(LENS, [wrong, *places[1:]])

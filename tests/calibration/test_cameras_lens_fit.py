"""The lens from corners of the board, against the lens that made them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from calibration.cameras.lens_fit import NoLensError, fit_lens
from tams_app.records import Lens
from tests.calibration.board_views import LENS, NOWHERE, shown

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


@settings(max_examples=4, deadline=None, phases=(Phase.explicit, Phase.generate))
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


@pytest.mark.parametrize("noise_px", [0.05, 0.2, 0.5])
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
    with pytest.raises(NoLensError, match="11 views of the board, 12 are needed"):
        fit_lens(shown(LENS, 27, 0)[:11], 640, 480)
    for tilt in (0.02, 0.2):
        with pytest.raises(NoLensError, match="tilt the board"):
            fit_lens(shown(LENS, 27, 0, 0.2, tilt=tilt), 640, 480)
    noisy = [replace(view, pixels=view.pixels * (1.0 + 0.01 * (number % 3)) + number)
             for number, view in enumerate(shown(LENS, 27, 0, 1.0))]  # fmt: skip
    with pytest.raises(NoLensError, match="is the board flat"):
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
    with pytest.raises(NoLensError, match=cause):
        fit_lens(views, 640, 480)

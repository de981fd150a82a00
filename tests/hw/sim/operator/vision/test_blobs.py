import math
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from hw.sim.operator.vision.blobs import HALF_TURN, Window, find_blobs, fit_yaw
from hw.sim.operator.vision.solids import BLUE, GREEN, ORANGE, block_corners
from hw.sim.operator.vision.views import wrist_cameras

pytestmark = pytest.mark.untimed

GREY, RED = (70, 66, 62), (30, 90, 230)


def _image(middle=(50.0, 45.0), edge=14.0, blur=0.8, noise=1.5, seed=0):
    """A block-coloured square on grey, drawn finely and reduced: true sub-pixel edges."""
    fine = 8
    large = np.full((100 * fine, 100 * fine, 3), GREY, np.uint8)
    low = [round((part + 0.5 - edge / 2) * fine) for part in middle]
    high = [round((part + 0.5 + edge / 2) * fine) - 1 for part in middle]
    cv2.rectangle(large, low, high, RED, -1)
    small = cv2.resize(large, (100, 100), interpolation=cv2.INTER_AREA).astype(float)
    if blur > 0.0:
        small = cv2.GaussianBlur(small, (0, 0), blur)
    small += np.random.default_rng(seed).normal(0.0, noise, small.shape)
    return np.clip(small, 0, 255).astype(np.uint8)


def _find(image, edge=14.0):
    return find_blobs(Window(0, 0, image), ORANGE, edge**2)


def _sigma(blob):
    return math.hypot(blob.sigma_px, blob.lasting_px)


def test_blur_is_measured_and_makes_the_middle_less_certain():
    blobs = [_find(_image(blur=blur))[0] for blur in (0.8, 2.0, 4.0)]
    widths = [blob.edge_px for blob in blobs]
    sigmas = [_sigma(blob) for blob in blobs]
    assert widths[0] < 0.7 * widths[1] < 0.5 * widths[2]
    assert sigmas[0] < sigmas[1] < sigmas[2]
    assert blobs[2].middle == pytest.approx((50.0, 45.0), abs=sigmas[2])


def test_noise_is_measured_and_makes_an_edge_less_certain():
    for noise, least in ((1.0, 0.0), (15.0, 0.02)):
        (blob,) = _find(_image(noise=noise))
        assert least <= blob.noise < least + 0.05
    silent = replace(blob, noise=0.0)
    assert blob.edge_sigma_px > silent.edge_sigma_px
    assert blob.sigma_px > silent.sigma_px


def test_errors_are_as_large_as_the_uncertainty_says():
    for blur, noise in ((0.8, 2.0), (2.0, 8.0), (3.0, 4.0)):
        errors, sigmas = [], []
        for seed in range(15):
            middle = tuple(45.0 + np.random.default_rng([seed, 1]).uniform(0, 1, 2))
            (blob,) = _find(_image(middle, blur=blur, noise=noise, seed=seed))
            errors.append(blob.middle - middle)
            sigmas.append(_sigma(blob))
        rms = float(np.sqrt(np.mean(np.square(errors))))
        assert rms < 2.0 * np.mean(sigmas)


def test_noise_is_anew_in_every_glance_and_blur_is_not():
    (sharp,), (blurred,) = _find(_image()), _find(_image(blur=3.0))
    assert blurred.lasting_px > 1.5 * sharp.lasting_px
    (noisy,) = _find(_image(noise=15.0))
    assert noisy.sigma_px > sharp.sigma_px
    assert noisy.lasting_px < 1.3 * sharp.lasting_px


def test_an_image_without_the_colour_shows_nothing():
    grey = np.full((100, 100, 3), GREY, np.uint8)
    assert _find(grey) == []
    assert find_blobs(Window(0, 0, _image()), GREEN, 196) == []
    assert find_blobs(Window(0, 0, _image()), BLUE, 196) == []


def test_what_fills_the_window_does_not_stand_out():
    dots = np.zeros((100, 100, 3), np.uint8)
    dots[::4, ::4, 2] = 255
    assert _find(dots, edge=6.0) == []


def test_a_blob_blurred_into_nothing_is_not_seen():
    assert _find(_image(edge=6.0, blur=8.0), edge=6.0) == []


def test_a_window_knows_where_it_lies_and_what_is_cut_off():
    image = _image()
    window = Window.about(image, np.array((50.0, 45.0)), 16.0)
    assert window is not None
    (blob,) = find_blobs(window, ORANGE, 196)
    assert blob.middle == pytest.approx((50.0, 45.0), abs=0.1)
    assert window.holds(blob)
    cut = Window.about(image, np.array((58.0, 45.0)), 10.0)
    assert not cut.holds(find_blobs(cut, ORANGE, 100)[0])
    assert Window.about(image, np.array((300.0, 45.0)), 10.0) is None


CAMERA = wrist_cameras()["eih"]
BELOW = np.array([0.0, 0.0, 0.10])  # of the TCP, in the tool's frame: z points down


def _draw(yaws, lying=False):
    corners = block_corners(BELOW, yaws, lying)
    return CAMERA.project(corners.reshape(-1, 3)).reshape(len(yaws), 8, 2)


@pytest.mark.parametrize("degrees", [-40, -20, -7, 0, 3, 15, 31, 44])
def test_the_yaw_is_read_off_the_outline(degrees):
    (outline,) = _draw(np.radians([degrees]))
    fitted = fit_yaw(outline, 0.3, _draw)
    off = (math.degrees(fitted.yaw) - degrees + 45) % 90 - 45
    assert abs(off) < 1.0
    assert math.radians(0.6) < math.hypot(fitted.sigma, fitted.lasting) < math.radians(5)


@pytest.mark.parametrize("degrees", [-80, -30, 10, 60])
def test_a_lying_block_is_told_from_a_standing_one_and_its_long_side_found(degrees):
    (outline,) = _draw(np.radians([degrees]), lying=True)
    fitted = fit_yaw(outline, 0.3, partial(_draw, lying=True), HALF_TURN)
    off = (math.degrees(fitted.yaw) - degrees + 90) % 180 - 90
    assert abs(off) < 1.0
    standing = fit_yaw(outline, 0.3, _draw)
    assert standing is None or standing.misfit_px > 2.0 * fitted.misfit_px + 0.2


def test_neither_place_nor_blur_of_the_outline_matter():
    (outline,) = _draw(np.radians([20]))
    away = outline - outline.mean(axis=0)
    grown = outline + 1.5 * away / np.linalg.norm(away, axis=1)[:, None] + (7.0, -4.0)
    assert math.degrees(fit_yaw(grown, 0.3, _draw).yaw) == pytest.approx(20, abs=3.0)


def test_rougher_edges_leave_more_doubt():
    (outline,) = _draw(np.radians([20]))
    assert fit_yaw(outline, 1.5, _draw).lasting > 1.5 * fit_yaw(outline, 0.3, _draw).lasting


def test_what_is_no_block_has_no_yaw():
    angles = np.linspace(0, 2 * np.pi, 40)
    long = np.column_stack((320 + 60 * np.cos(angles), 240 + 5 * np.sin(angles)))
    assert fit_yaw(long, 0.3, _draw) is None

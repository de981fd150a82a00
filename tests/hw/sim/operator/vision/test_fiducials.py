import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hw.sim.operator.vision.blobs import Window, level_counts
from hw.sim.operator.vision.fiducials import (
    Marker,
    MarkerFinder,
    gripper_faces,
    match_face,
    percentile,
)
from tams_app.records import Image

pytestmark = pytest.mark.untimed

EDGE = 40
SHIFT = np.array((2.0, -1.0))


def _image(identity=3, blur=0.6):
    code = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), identity, EDGE
    )
    image = np.full((120, 160, 3), 220, np.uint8)
    image[40 : 40 + EDGE, 60 : 60 + EDGE] = code[..., None]
    return cv2.GaussianBlur(image, (0, 0), blur)


def test_a_marker_is_found_with_its_corners_to_a_fraction_of_a_pixel():
    (marker,) = MarkerFinder().find(Window(10, 20, _image()[20:, 10:]))
    assert marker.identity == 3
    assert marker.corners.mean(axis=0) == pytest.approx((79.5, 59.5), abs=0.3)


def test_blurred_markers_have_wider_edges_and_at_last_are_none():
    finder, widths = MarkerFinder(), []
    for blur in (0.6, 2.0):
        assert finder.find(Window(0, 0, _image(blur=blur)))
        widths.append(finder.edge_px)
    assert widths[1] > 1.5 * widths[0]
    assert finder.find(Window(0, 0, _image(blur=8.0))) == []


def test_the_middle_of_an_oblique_marker_is_where_its_diagonals_cross():
    half, depth, slant = 1.0, 4.0, 1.0
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    seen = np.array([(x / (depth + slant * y), y / (depth + slant * y)) for x, y in corners])
    assert Marker(2, 100.0 * seen).middle == pytest.approx((0.0, 0.0), abs=1e-9)
    assert abs(100.0 * seen.mean(axis=0)[1]) > 1.0


def _flat(face):
    return 1000.0 * face[:, 1:] + 100.0 * face[:, :1]


def test_a_marker_is_matched_to_its_face_however_its_corners_are_counted():
    faces = gripper_faces()
    expected = [_flat(face) for face in faces]
    for face, pixels in zip(faces, expected, strict=True):
        for turn in range(4):
            seen = Marker(3, np.roll(pixels, turn, axis=0) + SHIFT)
            match, away_px = match_face("gt", seen, faces, expected, edge_px=1.0)
            assert away_px == pytest.approx(np.hypot(2, 1))
            assert _flat(match.points) + SHIFT == pytest.approx(match.pixels)
            assert sorted(map(tuple, match.points)) == sorted(map(tuple, face))


def test_what_the_corners_leave_over_is_their_uncertainty():
    faces = gripper_faces()
    expected = [_flat(face) for face in faces]
    wobble = np.array([(1.0, 0.0), (-1.0, 0.5), (0.5, -1.0), (-0.5, 0.5)])
    sharp, _ = match_face("gt", Marker(3, expected[0]), faces, expected, 1.0)
    rough, _ = match_face("gt", Marker(3, expected[0] + wobble), faces, expected, 1.0)
    blurred, _ = match_face("gt", Marker(3, expected[0]), faces, expected, 8.0)
    assert sharp.sigma_px < 0.3
    assert rough.warp_px > 2.0 * sharp.warp_px
    assert blurred.sigma_px > 2.0 * sharp.sigma_px


IMAGES = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(8, 40), st.integers(8, 40)),
    elements=st.one_of(st.sampled_from([0, 64, 255]), st.integers(0, 255)),
)


@given(IMAGES)
def test_levels_are_counted(image: Image) -> None:
    counts = level_counts(image[1:, 2:])
    np.testing.assert_array_equal(counts, np.bincount(image[1:, 2:].ravel(), minlength=256))


@given(IMAGES, st.sampled_from((0.0, 0.05, 0.5, 0.95, 1.0)))
def test_percentiles_are_numpy_s_to_the_last_bit(image: Image, part: float) -> None:
    assert percentile(level_counts(image), part) == np.percentile(image, 100 * part)
